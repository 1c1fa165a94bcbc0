"""The numbers that flights depend on, as they were tuned, measured or printed: none changes by the way.

What Tables 1 and 2 of the paper print is in test_presets and vehicle/test_profile. Whoever means to change a number
flies the league and the recorded leaders again, and writes the new fingerprint here.
"""

import json
from dataclasses import asdict
from hashlib import sha256

import pytest

from formation.config import FollowerConfig, LabConfig, LeaderConfig
from formation.control.presets import PRESETS
from formation.vehicle.profile import PROFILES

LAB = LabConfig(leader=LeaderConfig(body="a"), followers=(FollowerConfig(body="b", sysid=2, offset_m=(1.0, 0.0, 0.0)),))
HELD = {
    **{f"preset {name}": asdict(gains) for name, gains in PRESETS.items()},
    **{f"vehicle {name}": body.model_dump() for name, body in PROFILES.items()},
    **{f"a lab that says nothing of {part}": value.model_dump() for part, value in (("its limits", LAB.limits),
       ("its flight", LAB.flight), ("its leader's path", LAB.leader.trajectory))},
}  # fmt: skip
FINGERPRINTS = {
    "preset default": "b0291adfb59d",
    "preset pid_leader": "0c742d45bd9d",
    "preset paper": "855c6d295fb7",
    "preset paper_istsmc": "fb5b7db8a0d3",
    "preset paper_smc": "5735ab54c89e",
    "preset pid": "5276d90dcfbc",
    "preset geometric": "8ee7e3e8b8f4",
    "preset no_downwash": "b3b29b3ba6d2",
    "vehicle paper_40g": "1770b884a6f6",
    "vehicle paper_40g_printed": "1486635ff446",
    "vehicle px4_quad": "2ed2b7fc8b12",
    "vehicle arducopter_quad": "7112c247becf",
    "vehicle crazyflie_27g": "37c03f0ed4dc",
    "vehicle quad_250g": "e244328d0ca7",
    "vehicle x500": "6a50cf2c3da8",
    "a lab that says nothing of its limits": "f48e67dada4f",
    "a lab that says nothing of its flight": "338d792971a9",
    "a lab that says nothing of its leader's path": "b827c930e182",
}


@pytest.mark.parametrize("name", HELD)
def test_shipped_numbers_are_those_that_were_flown(name: str) -> None:
    assert sha256(json.dumps(HELD[name]).encode()).hexdigest()[:12] == FINGERPRINTS[name]

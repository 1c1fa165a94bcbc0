"""The triangle with each camera system's own protocol in the loop, over real sockets, in a turned room."""

import json
from pathlib import Path
from typing import Any

import pytest
from flights import LINE, UPSIDE_DOWN, gcs_sim_fly, write_scenario

from analysis.load import load
from analysis.metrics import summarise

pytestmark = [pytest.mark.processes, pytest.mark.flights, pytest.mark.timeout(900)]

WORSE = 1.2
TURNED = """
source = "{source}"
axes = ["x right", "y up", "z back"]
origin_lab_m = [0.3, -0.2, 0.1]
unit = "mm"
"""


def flown(scenario: Path, out: Path, *arguments: str) -> dict[str, Any]:
    with gcs_sim_fly(str(scenario), *arguments, "--out", str(out)) as process:
        said, _ = process.communicate()
    assert process.returncode == 0, said
    summary: dict[str, Any] = json.loads(summarise(load(out / "flight.mcap")).to_json())
    assert summary["outcome"] == "landed"
    return summary


@pytest.fixture(scope="module")
def plain_m(tmp_path_factory: pytest.TempPathFactory) -> float:
    """The formation error of the same flight with poses from the bus."""
    folder = tmp_path_factory.mktemp("plain")
    error_m: float = flown(write_scenario(folder, LINE), folder / "run")["formation_rms_m"]
    return error_m


@pytest.mark.parametrize(
    ("protocol", "source"),
    [("vrpn", "vrpn"), ("chingmu", "chingmu"), ("natnet", "natnet"), ("qtm", "qualisys"), ("vicon", "vicon")],
)
def test_a_turned_room_in_millimetres_flies_as_the_plain_one(
    protocol: str, source: str, plain_m: float, tmp_path: Path
) -> None:
    scenario = write_scenario(tmp_path, LINE, TURNED.format(source=source), UPSIDE_DOWN)
    summary = flown(scenario, tmp_path / "run", "--mocap", protocol)
    assert summary["formation_rms_m"] <= WORSE * plain_m

import json
import math
import tomllib
from dataclasses import replace

import pytest

from formation.config import LabConfig
from formation.vehicle.profile import VehicleProfile, profile
from gcs.doctor.checks import DroneReport, check_drone, refitted
from gcs.doctor.cli import write_profile
from gcs.drones.autopilot_model import ARDUPILOT_MODEL, PX4_MODEL
from gcs.finding import Finding, Fix, Grade, as_dicts
from tests.gcs.fakes import PX4_PARAMETERS
from wire.config_file import load

PAPER = profile("paper_40g")
GOOD = DroneReport(
    name="left", sysid=3, profile=PAPER, model=PX4_MODEL, version="1.16.1",
    parameters={**PX4_PARAMETERS, "MPC_THR_HOVER": PAPER.hover_thrust_norm}, unhealthy=(), packets=400, loss=0.0,
    round_trip_s=0.002, clock_offset_s=1.5, duplicate=False, foreign_sysid=None, battery=0.9,
)  # fmt: skip


def _check(**changes) -> dict[str, Finding]:
    return {f.check: f for f in check_drone(replace(GOOD, **changes)) if f.grade is not Grade.PASS}


def _parameters(**values) -> dict[str, float]:
    return {**GOOD.parameters, **values}


def test_a_good_drone_passes_and_a_silent_one_fails_and_passes_nothing():
    good = check_drone(GOOD)
    assert {f.grade for f in good} == {Grade.PASS}
    assert next(f for f in good if f.check == "autopilot").found == "PX4 1.16.1"
    nothing = {
        "model": None, "packets": 0, "parameters": {}, "unhealthy": None, "round_trip_s": math.nan,
        "clock_offset_s": None, "battery": math.nan,
    }  # fmt: skip
    findings = check_drone(replace(GOOD, **nothing))
    assert {f.check: f.grade for f in findings} == {"sysid is its own": Grade.FAIL, "heartbeat": Grade.FAIL}
    assert findings[0].found == "not measured"


def test_what_was_not_measured_does_not_pass():
    """Twenty packets tell neither of a twin nor of losses of a per cent; no battery message is no full battery."""
    findings = check_drone(
        replace(GOOD, packets=20, parameters={}, unhealthy=None, round_trip_s=math.nan, clock_offset_s=None,
                battery=math.nan, version="")
    )  # fmt: skip
    assert [f.check for f in findings if f.grade is Grade.PASS] == ["autopilot"]
    bad = {f.check: f.found for f in findings if f.found == "not measured"}
    assert set(bad) == {"sysid is its own", "link", "own health", "battery"}
    assert next(f for f in findings if f.check == "COM_OF_LOSS_T").found == "not answered"


@pytest.mark.parametrize(("hover", "grade"), [(1.08, None), (0.82, Grade.WARN), (1.2, Grade.WARN), (0.6, Grade.FAIL)])
def test_a_hover_thrust_other_than_the_profiles_asks_for_another_profile_and_never_for_another_parameter(hover, grade):
    """The autopilot has learned its value by flying; writing the profile's over it made a drone jump (0.39 -> 0.49)."""
    learned = hover * PAPER.hover_thrust_norm
    bad = _check(parameters=_parameters(MPC_THR_HOVER=learned))
    if grade is None:
        assert bad == {}
        return
    finding = bad["MPC_THR_HOVER"]
    assert finding.grade is grade
    assert "change the profile" in finding.why
    assert finding.fix is None
    assert finding.refit is not None
    assert json.loads(json.dumps(as_dicts([finding])))[0]["refit"]["toml"] == finding.refit.toml
    fitting = VehicleProfile.model_validate(tomllib.loads(finding.refit.toml)["profiles"][0])
    assert fitting.hover_thrust_norm == pytest.approx(learned, abs=5e-4)
    assert fitting.name == "paper_40g_3"
    for model in (PX4_MODEL, ARDUPILOT_MODEL):
        assert model.table.hover_parameter not in {rule.name for rule in model.rules}
    same = fitting.model_copy(update={"name": PAPER.name, "thrust_max_n": PAPER.thrust_max_n})
    assert same == PAPER


LAB_WITHOUT_PROFILE = """
[leader]
body = "lead"
[[followers]]
body = "left"
sysid = 2
offset_m = [0, 1, 0]
profile = "{name}"
[limits]
min_separation_m = 0.2
"""


def test_the_profile_is_written_to_a_file_that_a_lab_takes_and_over_nothing(tmp_path):
    refit = refitted(PAPER, 0.6, 2)
    assert "append it to the lab file as it is" in write_profile(refit, tmp_path)
    entry = (tmp_path / "profile-2.toml").read_text()
    lab = tmp_path / "lab.toml"
    lab.write_text(LAB_WITHOUT_PROFILE.format(name=refit.name) + entry)
    config = load(lab, LabConfig)
    assert config.profile_of(config.followers[0]).hover_thrust_norm == pytest.approx(0.6, abs=5e-4)
    assert "NOT written" in write_profile(refitted(PAPER, 0.7, 2), tmp_path)
    assert (tmp_path / "profile-2.toml").read_text() == entry


def test_parameters_are_judged_with_found_wanted_why_and_fix():
    bad = _check(parameters=_parameters(COM_OF_LOSS_T=5.0, COM_OBL_RC_ACT=0.0, EKF2_EV_CTRL=0.0, MPC_THR_HOVER=0.5))
    assert {name: (f.grade, f.found) for name, f in bad.items()} == {
        "COM_OF_LOSS_T": (Grade.FAIL, "5"),
        "COM_OBL_RC_ACT": (Grade.WARN, "0"),
        "EKF2_EV_CTRL": (Grade.FAIL, "0"),
        "MPC_THR_HOVER": (Grade.WARN, "0.50"),
    }
    assert "never measured" in bad["MPC_THR_HOVER"].why
    assert (bad["MPC_THR_HOVER"].fix, bad["MPC_THR_HOVER"].refit) == (None, None)
    finding = bad["COM_OF_LOSS_T"]
    assert finding.wanted == "0.1 to 0.2 s"
    assert finding.why
    assert finding.fix == Fix(3, "COM_OF_LOSS_T", pytest.approx(0.2))


def test_link_clock_health_battery_and_sysid():
    assert "two drones have this sysid" in _check(duplicate=True)["sysid is its own"].why
    assert _check(foreign_sysid=1)["sysid"].found == "drone 1 answers"
    bad = _check(loss=0.03, round_trip_s=0.05, unhealthy=("not armable",), battery=0.3)
    assert {check: f.grade for check, f in bad.items()} == dict.fromkeys(
        ("link", "clock", "own health", "battery"), Grade.WARN
    )
    assert _check(loss=0.2)["link"].grade is Grade.FAIL
    assert _check(round_trip_s=math.nan, clock_offset_s=None)["clock"].found == "no TIMESYNC"


def test_a_drone_of_no_named_profile_is_compared_with_what_it_says_itself():
    agrees = _check(names_profile=False)["profile"]
    assert (agrees.grade, agrees.found) == (Grade.WARN, "none named: paper_40g, 40 g, hovers at 0.61")
    other = _check(names_profile=False, parameters=_parameters(MPC_THR_HOVER=0.3))["profile"]
    assert other.grade is Grade.FAIL
    assert "the drone says MPC_THR_HOVER = 0.30" in other.why

import math
from dataclasses import replace

import pytest
from gcs_fakes import COPTER_PARAMETERS, PX4_PARAMETERS

from formation.vehicle import profile
from gcs.dialect import ARDUPILOT, PX4
from gcs.doctor.drone_checks import DroneReport, check_drone
from gcs.doctor.finding import Finding, Fix, Grade, failed

PAPER = profile("paper_40g")
GOOD = DroneReport(
    name="left", sysid=3, profile=PAPER, dialect=PX4, version="1.16.1",
    parameters={**PX4_PARAMETERS, "MPC_THR_HOVER": PAPER.hover_thrust_norm}, unhealthy=(), loss=0.0,
    round_trip_s=0.002, clock_offset_s=1.5, duplicate=False, foreign_sysid=None, battery=0.9,
)  # fmt: skip


def _check(feeds_pose: bool = True, **changes) -> dict[str, Finding]:
    return {f.check: f for f in check_drone(replace(GOOD, **changes), feeds_pose) if f.grade is not Grade.PASS}


def _parameters(**values) -> dict[str, float]:
    return {**GOOD.parameters, **values}


def test_a_good_drone_passes_and_is_named():
    findings = check_drone(GOOD, feeds_pose=True)
    assert not failed(findings)
    assert {f.grade for f in findings} == {Grade.PASS}
    assert next(f for f in findings if f.check == "autopilot").found == "PX4 1.16.1"


def test_a_silent_drone_fails():
    bad = _check(dialect=None)
    assert bad["heartbeat"].grade is Grade.FAIL


def test_a_duplicate_sysid_is_named():
    assert "two drones have this sysid" in _check(duplicate=True)["sysid is its own"].why
    assert _check(foreign_sysid=1)["sysid"].found == "drone 1 answers"


@pytest.mark.parametrize(
    ("hover", "grade"), [(1.0, None), (1.08, None), (0.82, Grade.WARN), (1.2, Grade.WARN), (0.5, Grade.FAIL)]
)
def test_a_wrong_hover_thrust_is_named_with_the_value_that_would_fit(hover, grade):
    bad = _check(parameters=_parameters(MPC_THR_HOVER=hover * PAPER.hover_thrust_norm))
    if grade is None:
        assert bad == {}
        return
    finding = bad["MPC_THR_HOVER"]
    assert finding.grade is grade
    assert "wrong hover thrust" in finding.why
    assert finding.fix == Fix(3, "MPC_THR_HOVER", round(PAPER.hover_thrust_norm, 3))


def test_parameters_are_judged_with_found_wanted_why_and_fix():
    bad = _check(parameters=_parameters(COM_OF_LOSS_T=5.0, COM_OBL_RC_ACT=0.0, EKF2_EV_CTRL=0.0))
    assert {name: f.grade for name, f in bad.items()} == {
        "COM_OF_LOSS_T": Grade.FAIL,
        "COM_OBL_RC_ACT": Grade.WARN,
        "EKF2_EV_CTRL": Grade.FAIL,
    }
    finding = bad["COM_OF_LOSS_T"]
    assert (finding.found, finding.wanted) == ("5", "0 to 2 s")
    assert finding.why
    assert finding.fix == Fix(3, "COM_OF_LOSS_T", 0.5)


def test_external_pose_is_not_asked_of_who_positions_itself():
    assert _check(feeds_pose=False, parameters=_parameters(EKF2_EV_CTRL=0.0)) == {}


def test_ardupilots_thrust_option_is_vital():
    hover = {"MOT_THST_HOVER": PAPER.hover_thrust_norm}
    bad = _check(dialect=ARDUPILOT, parameters={**COPTER_PARAMETERS, **hover, "GUID_OPTIONS": 0.0})
    assert set(bad) == {"GUID_OPTIONS"}
    assert bad["GUID_OPTIONS"].grade is Grade.FAIL


def test_what_was_not_answered_is_told():
    bad = _check(parameters={})
    assert {f.found for f in bad.values()} == {"not answered"}
    assert bad["COM_OF_LOSS_T"].grade is Grade.FAIL


def test_link_clock_health_and_battery():
    bad = _check(loss=0.03, round_trip_s=0.05, unhealthy=("not armable",), battery=0.3)
    assert {check: f.grade for check, f in bad.items()} == dict.fromkeys(
        ("link", "clock", "own health", "battery"), Grade.WARN
    )
    assert _check(loss=0.2)["link"].grade is Grade.FAIL
    assert _check(round_trip_s=math.nan, clock_offset_s=None)["clock"].found == "no TIMESYNC"

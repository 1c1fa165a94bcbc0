"""Arming where a parameter was set right that the autopilot reads only as it boots: PX4's EKF2_HGT_REF."""

import pytest

from formation.messages import Phase, UnmetParameter, Verb
from tests.gcs.fakes import AHEAD_NS, FakeLab, refusal, triangle

REFUSED = (
    "left: EKF2_HGT_REF was changed and counts from a restart, which was not seen: restart the autopilot of drone 2 "
    "(off for 3 s) while gcs run or gcs doctor runs; or, where it was, delete ...-restarts.toml beside the lab file"
)


@pytest.fixture
def lab() -> FakeLab:
    lab = FakeLab(triangle())
    lab.run(2.0)
    return lab


def _reboot(lab: FakeLab, sysid: int, own_clock: bool = True) -> None:
    """Silent for three seconds; its clock begins anew, or is that of a computer that went on."""
    drone = lab.drones[sysid]
    drone.sends_nothing = drone.receives_nothing = True
    lab.run(3.0)
    drone.sends_nothing = drone.receives_nothing = False
    drone.ahead_ns = -lab.now_ns if own_clock else drone.ahead_ns
    lab.run(3.0)


@pytest.mark.parametrize("own_clock", [True, False])
def test_a_drone_that_did_not_boot_since_the_doctor_wrote_is_not_armed(lab, own_clock):
    lab.core.receive(UnmetParameter(2, "EKF2_HGT_REF", lab.now_ns), lab.now_ns)
    assert REFUSED in refusal(lab, Verb.ARM)
    before_ns = lab.now_ns
    _reboot(lab, 2, own_clock)
    assert lab.core.booted_ns(2) > before_ns
    lab.command(Verb.ARM, Phase.ARMED)


def test_what_was_written_before_the_drone_booted_counts(lab):
    lab.core.receive(UnmetParameter(2, "EKF2_HGT_REF", -AHEAD_NS - 1_000_000_000), lab.now_ns)
    lab.command(Verb.ARM, Phase.ARMED)


def test_a_parameter_that_the_ground_saw_wrong_and_then_right_counts_from_a_restart_too():
    lab = FakeLab(triangle())
    lab.drones[2].parameters["EKF2_HGT_REF"] = 1
    lab.run(2.0)
    assert not any("restart" in text for text in lab.state.prearm_failures)
    lab.drones[2].parameters["EKF2_HGT_REF"] = 3
    lab.core._links[2].reread_parameters()
    lab.run(2.0)
    assert REFUSED in refusal(lab, Verb.ARM)
    _reboot(lab, 2)
    lab.command(Verb.ARM, Phase.ARMED)


def test_a_drone_whose_clock_is_not_known_is_not_armed():
    lab = FakeLab(triangle())
    lab.core.receive(UnmetParameter(2, "EKF2_HGT_REF", 0), lab.now_ns)
    lab.drones[2]._react = lambda *_: None  # answers neither TIMESYNC nor anything else
    lab.run(2.0)
    assert REFUSED in lab.state.prearm_failures

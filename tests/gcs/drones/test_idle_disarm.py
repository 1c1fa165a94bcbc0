"""An armed drone that does not take off disarms by itself: shown, counted with, and no fault when it happens."""

import re

import pytest

from formation.messages import Cause, EventCode, Phase, Severity, Verb
from gcs.drones.telemetry import ArmedClock
from tests.gcs.fakes import FakeLab, accepted, refusal, triangle
from wire.link_messages import MavAutopilot

MAKES = [MavAutopilot.PX4, MavAutopilot.ARDUPILOT]
PARAMETER = {MavAutopilot.PX4: "COM_DISARM_PRFLT", MavAutopilot.ARDUPILOT: "DISARM_DELAY"}


def _armed(autopilot: MavAutopilot = MavAutopilot.PX4, timeout_s: float = 10.0) -> FakeLab:
    lab = FakeLab(triangle(), dict.fromkeys((1, 2, 3), autopilot))
    for drone in lab.drones.values():
        drone.parameters[PARAMETER[autopilot]] = timeout_s
    lab.run(3.0)
    lab.command(Verb.ARM, Phase.ARMED)
    return lab


def _countdown(lab: FakeLab) -> list[float | None]:
    return [drone.disarms_in_s for drone in lab.state.drones]


def _loud(lab: FakeLab) -> list[str]:
    return [e.text for name, e in lab.records if name == "event" and e.severity < Severity.WARNING]


def test_the_countdown_is_reported_from_arming_until_the_drone_is_off_the_floor():
    lab = _armed()
    told = re.search(r"take off within (\d\.\d) s", lab.replies[-1].text)
    assert told is not None
    assert 5.0 < float(told[1]) < 7.0
    assert _countdown(lab) == pytest.approx([float(told[1]) + 3.0] * 3, abs=0.1)
    lab.run(2.0)
    assert _countdown(lab) == pytest.approx([float(told[1]) + 1.0] * 3, abs=0.1)
    accepted(lab, Verb.TAKEOFF)
    lab.run_until(Phase.HOLD)
    assert _countdown(lab) == [None] * 3


@pytest.mark.parametrize("autopilot", MAKES)
def test_the_parameter_as_read_counts(autopilot):
    assert _countdown(_armed(autopilot, 20)) == pytest.approx([19.0] * 3, abs=0.6)
    assert _countdown(_armed(autopilot, 0)) == [None] * 3


def test_a_take_off_that_the_time_out_would_cut_is_rejected_with_the_seconds_it_needs():
    lab = _armed()
    lab.run(6.5)
    assert (EventCode.TAKE_OFF_TOO_LATE, "") in lab.reported
    refused = refusal(lab, Verb.TAKEOFF)
    remedy = "`gcs land`, then `gcs arm`"
    assert re.match(rf"lead: disarms itself in [12]\.\d s, a take-off needs 3 s: {remedy}; left: ", refused)
    assert lab.phase is Phase.ARMED
    lab.command(Verb.LAND, Phase.GROUND)
    lab.run(2.0)
    lab.command(Verb.ARM, Phase.ARMED)
    accepted(lab, Verb.TAKEOFF)


@pytest.mark.parametrize("autopilot", MAKES)
def test_a_drone_that_disarms_itself_on_the_floor_brings_the_swarm_back_to_the_ground_without_a_fault(autopilot):
    lab = _armed(autopilot)
    lab.run(8.5)
    lab.drones[2].armed = False
    lab.run_until(Phase.GROUND, longest_s=2.0)
    lab.run(3.0)
    assert not any(drone.armed for drone in lab.drones.values())
    name = PARAMETER[autopilot]
    assert f"ARMED -> GROUND: left disarmed itself: no take-off in 10 s ({name})" in lab.events
    assert _loud(lab) == []
    lab.command(Verb.ARM, Phase.ARMED)


@pytest.mark.parametrize("by_operator", [False, True])
def test_a_take_off_that_ends_on_the_floor_spins_nobody_up(by_operator):
    """One disarms itself on the floor, or a landing is asked for before anybody has risen."""
    lab = _armed()
    lab.run(1.0)
    accepted(lab, Verb.TAKEOFF)
    if by_operator:
        lab.run(0.3)
        lab.command(Verb.LAND, Phase.LAND)
    else:
        lab.drones[2].armed = False
        lab.run_until(Phase.LAND, longest_s=1.5)
        assert lab.causes[-1] is Cause.DISARMED
    stayed = [drone for drone in lab.drones.values() if drone.pos[2] == 0.0]
    for drone in stayed:
        drone.setpoints.clear()
    lab.run_until(Phase.GROUND, longest_s=6.0)
    assert lab.drones[2] in stayed
    assert all(s.thrust_norm < 0.4 * by_operator + 1e-9 for drone in stayed for _, s in drone.setpoints)
    assert not any(drone.armed for drone in lab.drones.values())
    assert _loud(lab) == []


def test_the_clock_starts_with_the_answer_and_never_later_than_arming_can_have_been():
    clock = ArmedClock()
    clock.receive_heartbeat(False, 1_000)
    clock.accept(1_300)
    clock.accept(1_500)  # the answer to a repeated command
    clock.receive_heartbeat(True, 2_000)
    clock.receive_heartbeat(True, 3_000)
    assert clock.since_ns == 1_300
    clock.receive_heartbeat(False, 9_000)
    assert (clock.since_ns, clock.lasted_s) == (None, 7_700e-9)
    clock.receive_heartbeat(True, 10_000)
    assert clock.since_ns == 9_000  # armed by somebody else: at some time since it was heard disarmed

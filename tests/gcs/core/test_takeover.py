"""A ground that begins while drones fly: it arms nobody, and can stop or land them, or take control."""

import numpy as np
import pytest

from formation.messages import Cause, EventCode, HostReport, Phase, Verb
from formation.reasons import Reason
from tests.gcs.fakes import FakeLab, commands, flying, reasons, refusal, triangle
from wire.link_messages import (
    Address,
    AttitudeSetpoint,
    CommandAck,
    CommandLong,
    ExtendedSysState,
    Heartbeat,
    LandedState,
    MavAutopilot,
    Result,
    ground_address,
)
from wire.mavlink.codec import Codec


def restarted(after_s: float = 0.5, autopilots=None, heard_s: float = 3.5) -> FakeLab:
    """Drones that hold their place, and a new ground that has heard them for so long."""
    lab = FakeLab(triangle(), autopilots)
    lab.fly()
    lab.run(1.0)
    lab.restart_ground(after_s)
    lab.run(heard_s)
    for drone in lab.drones.values():
        drone.heard.clear()
        drone.setpoints.clear()
    return lab


def test_a_restarted_ground_asked_to_arm_drops_nobody():
    lab = restarted()
    text, found = refusal(lab, Verb.ARM), reasons(lab, Verb.ARM)
    assert found[:4] == [Reason.FLYING, *[Reason.ARMED_IN] * 3]
    assert text.split("; ")[1:4] == [f"{name}: armed, in OFFBOARD" for name in ("lead", "left", "right")]
    lab.run(3.0)
    assert all(not drone.setpoints for drone in lab.drones.values())
    assert all(drone.pos[2] > 0.25 for drone in lab.drones.values())
    status = lab.state
    assert status.reject_codes[Verb.ARM][0] == Reason.FLYING.code
    assert status.ground_session == 1


@pytest.mark.parametrize("heard_s", [0.0, 3.5])
def test_land_from_ground_has_each_autopilot_land_its_drone_and_sends_no_setpoint(heard_s):
    lab = restarted(heard_s=heard_s)
    lab.land()
    for drone in lab.drones.values():
        assert commands(drone, 21)
        assert not drone.setpoints
    assert refusal(lab, Verb.TAKEOFF)
    lab.run(1.0)
    lab.command(Verb.ARM, Phase.ARMED)
    lab.command(Verb.STOP, Phase.STOPPED)  # from the ground too
    lab.run(0.05)
    assert all(commands(drone, 400)[-1].params[:2] == (0.0, 21196.0) for drone in lab.drones.values())
    assert not any(drone.armed for drone in lab.drones.values())


def test_land_on_the_ground_with_nobody_flying_changes_nothing():
    lab = FakeLab(triangle())
    lab.run(2.0)
    assert reasons(lab, Verb.LAND) == [Reason.NONE_FLIES]
    lab.command(Verb.ARM, Phase.ARMED)


@pytest.mark.parametrize(("make", "knows_owners"), [(MavAutopilot.PX4, True), (MavAutopilot.ARDUPILOT, False)])
def test_drones_taken_over_hold_where_they_are_and_fly_on(make, knows_owners):
    lab = restarted(autopilots=dict.fromkeys((1, 2, 3), make))
    for drone in lab.drones.values():
        drone.knows_owners = knows_owners
        drone.owner = drone.owner if knows_owners else ground_address(1)
    before = {sysid: drone.pos.copy() for sysid, drone in lab.drones.items()}
    lab.command(Verb.TAKE_CONTROL, Phase.HOLD)
    lab.run(4.0)
    assert lab.phase is Phase.HOLD
    for sysid, drone in lab.drones.items():
        asked = commands(drone, 32100)
        assert asked[0].params[:2] == (255.0, 1.0)
        assert not commands(drone, 400)
        assert len(drone.setpoints) > 300
        assert min(s.thrust_norm for _, s in drone.setpoints) > 0.7 * drone.hover
        assert np.linalg.norm(drone.pos - before[sysid]) < 0.05
    lab.command(Verb.START, Phase.FORMATION)
    lab.run(2.0)
    assert lab.phase is Phase.FORMATION
    lab.land()


def held_aside() -> FakeLab:
    """Drones in a mode of their own, just taken over."""
    lab = restarted()
    for drone in lab.drones.values():
        drone.mode = 4 << 16 | 3 << 24  # PX4's HOLD
    lab.run(1.5)
    lab.command(Verb.TAKE_CONTROL, Phase.HOLD)
    return lab


def test_drones_that_hold_in_a_mode_of_their_own_are_brought_back_to_off_board():
    lab = held_aside()
    assert set(reasons(lab, Verb.START)) == {Reason.JOINING}
    lab.run(4.0)
    assert lab.phase is Phase.HOLD
    assert all(drone.mode == drone.offboard for drone in lab.drones.values())
    assert all(drone.pos[2] > 0.2 for drone in lab.drones.values())
    drone = lab.drones[1]
    kinds = [type(m) for m in drone.heard]
    modes = [k for k, m in enumerate(drone.heard) if isinstance(m, CommandLong) and m.command == 176]
    assert kinds[: modes[0]].count(AttitudeSetpoint) >= 100


@pytest.mark.parametrize("where", ["on the floor", "landing"])
def test_where_one_is_down_or_lands_by_itself_those_that_fly_are_landed(where):
    lab = FakeLab(triangle(flight={"altitude_m": 1.5}))
    lab.fly()
    lab.restart_ground(0.5)
    if where == "landing":
        lab.drones[2].mode = lab.drones[2].land
    else:
        lab.drones[2].armed, lab.drones[2].pos[2] = False, 0.0
    lab.run(1.5)
    lab.command(Verb.TAKE_CONTROL, Phase.LAND)
    assert lab.causes[-1] is Cause.LANDS_ITSELF
    lab.run_until(Phase.GROUND)
    assert not any(drone.armed for drone in lab.drones.values())


def test_rejects_take_control_without_poses_or_armed_drones():
    lab = restarted()
    lab.hidden.add("left")
    lab.run(0.3)
    assert Reason.NO_POSE_TO_LEAD in reasons(lab, Verb.TAKE_CONTROL)
    assert lab.phase is Phase.GROUND
    idle = FakeLab(triangle())
    idle.run(2.0)
    assert reasons(idle, Verb.TAKE_CONTROL) == [Reason.NONE_ARMED]


def test_a_drone_that_answers_another_ground_keeps_this_one_from_arming_for_three_seconds():
    lab = FakeLab(triangle())
    lab.run(2.0)
    lab.drones[2]._say(CommandAck(ground_address(7), 511, Result.ACCEPTED))
    lab.run(0.1)
    assert refusal(lab, Verb.ARM) == "another ground is alive (left answers another ground): end it first"
    lab.drones[2]._say(CommandAck(Address(255, 190), 511, Result.ACCEPTED))  # a ground station of another make
    lab.run(3.0)
    assert lab.core.phase is Phase.GROUND
    lab.command(Verb.ARM, Phase.ARMED)


def test_another_ground_on_the_bus_forbids_arming_and_taking_control():
    lab = restarted()
    lab.core.receive(HostReport(other_grounds=("gcs/0-77",)), lab.now_ns)
    lab.run(0.1)
    assert (EventCode.OTHER_GROUND, "gcs/0-77") in lab.reported
    assert Reason.OTHER_GROUND in reasons(lab, Verb.ARM)
    assert refusal(lab, Verb.TAKE_CONTROL) == "another ground is alive (ground gcs/0-77): end it first"
    lab.core.receive(HostReport(), lab.now_ns)
    lab.command(Verb.TAKE_CONTROL, Phase.HOLD)


def test_each_session_speaks_from_an_address_of_its_own_and_says_so():
    lab = FakeLab(triangle())
    lab.run(1.5)
    lab.restart_ground()
    heard = []
    lab.drones[1].receive = lambda data, _now: heard.extend(Codec(Address(1, 1)).receive(data))
    lab.run(1.5)
    assert {packet.source for packet in heard} == {Address(255, 26)}
    assert {p.message.custom_mode for p in heard if isinstance(p.message, Heartbeat)} == {1}


def test_log_trouble_is_reported_forbids_arming_and_changes_no_setpoint():
    def flight(trouble: str) -> FakeLab:
        lab = flying()
        lab.core.receive(HostReport(log_trouble=trouble), lab.now_ns)
        lab.run(1.0)
        return lab

    well, ill = flight(""), flight("the disk is full")
    assert (EventCode.LOG, "") in ill.reported
    assert ill.state.log_trouble == "the disk is full"
    for mine, other in zip(well.drones.values(), ill.drones.values(), strict=True):
        assert [(t, s.thrust_norm, s.q_lab_from_flu.tobytes()) for t, s in mine.setpoints] == [
            (t, s.thrust_norm, s.q_lab_from_flu.tobytes()) for t, s in other.setpoints
        ]
    ill.land()
    ill.run(1.5)
    assert refusal(ill, Verb.ARM) == "the log: the disk is full"
    ill.core.receive(HostReport(button_trouble="the stop button does not work: gone"), ill.now_ns)
    ill.run(0.1)
    assert reasons(ill, Verb.ARM) == [Reason.STOP_BUTTON]
    ill.core.receive(HostReport(), ill.now_ns)
    ill.command(Verb.ARM, Phase.ARMED)
    assert ("over log", "") in ill.reported


def test_a_drone_that_comes_down_while_it_is_taken_over_is_not_led_up_again():
    lab = held_aside()
    lab.drones[3]._say(ExtendedSysState(LandedState.ON_GROUND))
    lab.run(0.1)
    assert (lab.causes[-1], lab.phase) == (Cause.LANDS_ITSELF, Phase.LAND)
    lab.run_until(Phase.GROUND)
    assert not any(drone.armed for drone in lab.drones.values())


def test_a_drone_that_does_not_follow_within_five_seconds_has_all_land():
    lab = held_aside()
    obey = lab.drones[1]._obey
    lab.drones[1]._obey = lambda c: Result.DENIED if c.command == 176 else obey(c)
    lab.run(4.5)
    assert lab.phase is Phase.HOLD
    lab.run(1.5)
    assert lab.phase is Phase.LAND
    assert ("rule-not-offboard", "lead") in lab.reported
    lab.run_until(Phase.GROUND)
    assert not any(drone.armed for drone in lab.drones.values())

"""Flying on with who is ready: drones that are left out, landed alone, taken in again; and all led home."""

import numpy as np
import pytest

from formation.codes import Cause
from formation.messages import Phase, Verb
from formation.reasons import Reason
from tests.gcs.fakes import STAY, FakeLab, accepted, commands, reasons, refusal, triangle
from wire.link_messages import MavCommand

LEFT, RIGHT = 2, 3


@pytest.fixture
def lab() -> FakeLab:
    """A leader and two followers on the floor; the battery of `left` has been taken out."""
    lab = FakeLab(triangle(leader=STAY))
    lab.drones[LEFT].sends_nothing = True
    lab.hidden.add("left")
    lab.run(2.0)
    return lab


def test_the_others_fly_without_a_dead_drone_and_its_slot_stays_empty(lab: FakeLab) -> None:
    assert Reason.NO_HEARTBEAT in reasons(lab, Verb.ARM)
    assert accepted(lab, Verb.EXCLUDE, "left") == "phase GROUND, shape configured, without left"
    lab.fly()
    lab.run(6.0)
    assert lab.phase is Phase.FORMATION
    assert lab.state.trajectory_started
    np.testing.assert_allclose(lab.drones[RIGHT].pos - lab.drones[1].pos, [-0.4, -0.4, 0.0], atol=0.02)
    assert [drone.excluded for drone in lab.state.drones] == [False, True, False]
    lab.land()
    assert lab.causes[-1] is Cause.LANDED
    assert lab.drones[LEFT].setpoints == []
    assert commands(lab.drones[LEFT], MavCommand.COMPONENT_ARM_DISARM) == []
    assert not lab.state.not_landed


def test_arm_names_who_flies_and_changes_nothing_where_it_is_refused(lab: FakeLab) -> None:
    lab.hidden.add("right")
    lab.run(0.5)
    assert Reason.NO_POSE in reasons(lab, Verb.ARM, "lead,right")
    assert not any(drone.excluded for drone in lab.state.drones)
    assert ("excluded", "left") not in lab.reported
    lab.hidden.remove("right")
    lab.run(0.5)
    lab.ask(Verb.ARM, "lead,right")
    lab.run_until(Phase.ARMED)
    lab.run(3.0)
    assert [lab.drones[sysid].armed for sysid in (1, LEFT, RIGHT)] == [True, False, True]


@pytest.mark.parametrize(
    ("verb", "argument", "reason"),
    [
        (Verb.EXCLUDE, "middle", Reason.NO_DRONE),
        (Verb.EXCLUDE, "", Reason.NO_DRONE),
        (Verb.EXCLUDE, "lead", Reason.LEADER_NEEDED),
        (Verb.EXCLUDE, "left,right", Reason.NONE_LEFT),
        (Verb.ARM, "left,right", Reason.LEADER_NEEDED),
        (Verb.INCLUDE, "middle", Reason.NO_DRONE),
    ],
)
def test_who_cannot_be_left_out_is_named(lab: FakeLab, verb: Verb, argument: str, reason: Reason) -> None:
    assert reasons(lab, verb, argument) == [reason]
    assert not any(drone.excluded for drone in lab.state.drones)


@pytest.mark.parametrize(("body", "reason"), [("right", Reason.LEADER_NEEDED), ("lead", Reason.NONE_LEFT)])
def test_one_drone_is_armed_alone_and_never_takes_off(lab: FakeLab, body: str, reason: Reason) -> None:
    lab.ask(Verb.ARM, body)
    lab.run(4.0)
    assert [drone.body for drone in lab.state.drones if drone.armed] == [body]
    assert reason in reasons(lab, Verb.TAKEOFF)
    assert lab.phase is Phase.ARMED
    lab.command(Verb.LAND, Phase.GROUND)
    lab.run(2.0)
    assert not any(drone.armed for drone in lab.state.drones)
    assert reason in reasons(lab, Verb.EXCLUDE, "left")


def test_in_the_air_nobody_is_left_out_and_in_formation_nobody_taken_in(lab: FakeLab) -> None:
    accepted(lab, Verb.EXCLUDE, "left")
    lab.take_off()
    assert refusal(lab, Verb.EXCLUDE, "left").endswith("this is HOLD: `gcs land BODY` lands that drone alone")
    accepted(lab, Verb.START)
    assert reasons(lab, Verb.INCLUDE, "left") == [Reason.OUT_OF_TURN]


def test_with_a_new_battery_it_is_taken_in_again(lab: FakeLab) -> None:
    accepted(lab, Verb.EXCLUDE, "left")
    lab.drones[LEFT].sends_nothing = False
    lab.hidden.clear()
    lab.run(3.0)
    assert accepted(lab, Verb.INCLUDE, "left") == "phase GROUND, shape configured"
    lab.fly()
    lab.run(6.0)
    np.testing.assert_allclose(lab.drones[LEFT].pos - lab.drones[1].pos, [-0.4, 0.4, 0.0], atol=0.02)


def test_a_shape_is_filled_by_those_who_fly(lab: FakeLab) -> None:
    """In a column the slots are 0.5 m and 1 m behind the leader: the one who flies takes the nearer."""
    accepted(lab, Verb.EXCLUDE, "left")
    lab.fly()
    lab.run(4.0)
    accepted(lab, Verb.SHAPE, "column")
    lab.run(6.0)
    np.testing.assert_allclose(lab.drones[RIGHT].pos - lab.drones[1].pos, [-0.5, 0.0, 0.0], atol=0.02)


def test_a_drone_that_is_left_out_and_armed_by_somebody_keeps_the_others_on_the_ground(lab: FakeLab) -> None:
    accepted(lab, Verb.EXCLUDE, "left")
    lab.drones[LEFT].sends_nothing, lab.drones[LEFT].armed = False, True
    lab.run(1.5)
    assert Reason.ARMED_IN in reasons(lab, Verb.ARM)


def test_a_stop_cuts_its_motors_too_and_a_reset_waits_for_no_dead_drone(lab: FakeLab) -> None:
    accepted(lab, Verb.EXCLUDE, "left")
    lab.take_off()
    lab.ask(Verb.STOP)
    lab.run(2.5)
    assert commands(lab.drones[LEFT], MavCommand.COMPONENT_ARM_DISARM)
    assert not lab.state.not_landed
    lab.command(Verb.RESET, Phase.GROUND)


def test_after_a_stop_a_dead_drone_is_left_out_to_reset(lab: FakeLab) -> None:
    lab.ask(Verb.STOP)
    lab.run(2.5)
    assert reasons(lab, Verb.RESET) == [Reason.MAY_BE_ARMED]
    accepted(lab, Verb.EXCLUDE, "left")
    lab.command(Verb.RESET, Phase.GROUND)


def test_it_is_kept_clear_of_where_it_stands(lab: FakeLab) -> None:
    """Seen, though left out: nobody arms beside it, and no rule is about what it does."""
    lab.hidden.clear()
    accepted(lab, Verb.EXCLUDE, "left")
    lab.drones[LEFT].pos[:] = lab.drones[RIGHT].pos + np.array([0.1, 0.0, 0.0])
    lab.run(0.5)
    assert reasons(lab, Verb.ARM) == [Reason.TOO_NEAR]
    lab.drones[LEFT].pos[:] = [-0.4, 0.9, 0.0]
    lab.run(0.5)
    lab.take_off()
    lab.hidden.add("left")  # carried away
    lab.run(2.0)
    assert lab.phase is Phase.HOLD


@pytest.fixture
def flying() -> FakeLab:
    lab = FakeLab(triangle(leader=STAY))
    lab.fly()
    lab.run(4.0)
    return lab


def nearest_m(lab: FakeLab, steps: int) -> float:
    """The least distance between any two in the next so many steps, which are flown."""
    nearest = np.inf
    for _ in range(steps):
        lab.step()
        pos = np.array([drone.pos for drone in lab.drones.values()])
        apart = np.linalg.norm(pos[:, None] - pos[None], axis=-1)
        nearest = min(nearest, apart[apart > 0.0].min())
    return float(nearest)


def test_one_lands_alone_and_the_others_fly_on(flying: FakeLab) -> None:
    accepted(flying, Verb.LAND, "left")
    nearest = nearest_m(flying, 1000)
    left = flying.drones[LEFT]
    assert (flying.phase, left.armed) == (Phase.FORMATION, False)
    assert left.pos[2] < 0.03
    assert nearest > 0.3
    assert [drone.excluded for drone in flying.state.drones] == [False, True, False]
    np.testing.assert_allclose(flying.drones[RIGHT].pos - flying.drones[1].pos, [-0.4, -0.4, 0.0], atol=0.02)
    flying.land()
    assert flying.causes[-1] is Cause.LANDED
    assert accepted(flying, Verb.INCLUDE, "left") == "phase GROUND, shape configured"


def test_who_lands_alone_goes_on_landing_in_a_hold_and_lands_with_all(flying: FakeLab) -> None:
    accepted(flying, Verb.LAND, "left")
    flying.command(Verb.HOLD, Phase.HOLD)
    flying.run(2.0)
    assert flying.drones[LEFT].pos[2] < flying.drones[RIGHT].pos[2] - 0.1
    flying.land()


def test_a_formation_that_moves_is_left_beside_its_way() -> None:
    """In a column behind a leader that flies ahead: the last one will pass above where the one before it is."""
    line = {"kind": "line", "length_m": 1.5, "period_s": 20.0}
    lab = FakeLab(triangle(leader={"body": "lead", "sysid": 1, "trajectory": line}))
    lab.take_off()
    accepted(lab, Verb.SHAPE, "column")
    lab.command(Verb.START, Phase.FORMATION)
    lab.run(5.0)
    first = max(LEFT, RIGHT, key=lambda sysid: lab.drones[sysid].pos[0])
    accepted(lab, Verb.LAND, "left" if first == LEFT else "right")
    nearest = nearest_m(lab, 1200)
    assert (lab.phase, lab.drones[first].armed) == (Phase.FORMATION, False)
    assert abs(lab.drones[first].pos[1]) >= 0.29
    assert nearest > 0.25


@pytest.mark.parametrize(
    ("body", "reason"), [("lead", Reason.LEADER_NEEDED), ("middle", Reason.NO_DRONE), ("left", Reason.NOT_FLYING)]
)
def test_who_cannot_land_alone_is_named(flying: FakeLab, body: str, reason: Reason) -> None:
    accepted(flying, Verb.LAND, "left")
    assert reasons(flying, Verb.LAND, body) == [reason]
    assert reasons(flying, Verb.LAND, "right") == [Reason.NONE_LEFT]


def test_a_drone_that_leaves_and_is_not_seen_lands_the_swarm(flying: FakeLab) -> None:
    accepted(flying, Verb.LAND, "left")
    flying.hidden.add("left")
    flying.run(1.0)
    assert flying.phase is Phase.LAND


def test_all_are_led_home_each_above_where_it_took_off() -> None:
    """From the end of a line, out of a column: forming as they stood, nobody comes near anybody."""
    line = {"kind": "line", "length_m": 1.5, "period_s": 12.0, "duration_s": 6.0}
    lab = FakeLab(triangle(leader={"body": "lead", "sysid": 1, "trajectory": line}))
    started = {sysid: drone.pos.copy() for sysid, drone in lab.drones.items()}
    lab.take_off()
    accepted(lab, Verb.SHAPE, "column")
    lab.command(Verb.START, Phase.FORMATION)
    lab.run(13.0)
    assert lab.drones[1].pos[0] > 0.7
    accepted(lab, Verb.HOME)
    nearest = nearest_m(lab, 1500)
    for sysid, drone in lab.drones.items():
        np.testing.assert_allclose(drone.pos[:2], started[sysid][:2], atol=0.03)
    assert nearest > 0.25
    assert ("home", "") in lab.reported
    lab.land()
    assert lab.state.shape == "column"


def test_home_from_a_hold_forms_first(flying: FakeLab) -> None:
    flying.command(Verb.HOLD, Phase.HOLD)
    accepted(flying, Verb.HOME)
    flying.run(5.0)
    assert (flying.phase, flying.state.shape) == (Phase.FORMATION, "home")
    assert not flying.state.trajectory_started
    assert reasons(flying, Verb.SHAPE, "line") == [Reason.LED_HOME]
    flying.command(Verb.HOLD, Phase.HOLD)
    accepted(flying, Verb.SHAPE, "line")


def test_no_home_without_a_start_of_this_ground_or_a_leader_of_its_own() -> None:
    lab = FakeLab(triangle(leader={"body": "lead"}))
    assert Reason.OUT_OF_TURN in reasons(lab, Verb.HOME)
    lab.fly()
    assert Reason.LEADER_OBSERVED in reasons(lab, Verb.HOME)

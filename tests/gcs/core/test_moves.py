"""An operator moves the leader in formation, or one drone in HOLD, by velocity: within the fence, clear of others."""

import numpy as np
import pytest

from formation.codes import Cause
from formation.config import Fence
from formation.messages import Phase, Verb
from formation.reasons import Reason
from gcs.moves import HELD_NS, Surroundings, asked_of, limited
from tests.gcs.fakes import STAY, FakeLab, accepted, flying, reasons, triangle

FENCE = {"fence": {"low_m": (-1.5, -1.5, -0.1), "high_m": (1.5, 1.5, 1.5)}}
INSIDE_M = 0.05  # of the inset of 0.1 m the drone's own error takes less than half


def moved(lab: FakeLab, velocity: str, seconds: float, body: str = "lead") -> None:
    """Ask for it twenty times a second, as a gamepad does."""
    for _ in range(round(seconds * 20)):
        if lab.phase in (Phase.HOLD, Phase.FORMATION):
            accepted(lab, Verb.MOVE, f"{body} {velocity}")
        lab.run(0.05)


@pytest.fixture
def formed() -> FakeLab:
    lab = flying(leader=STAY, limits=FENCE)
    lab.run(4.0)
    return lab


def test_the_leader_is_flown_and_its_followers_keep_their_slots(formed: FakeLab) -> None:
    start = formed.drones[1].pos.copy()
    moved(formed, "0.3 0.0 0.1 0.0", 2.0)
    np.testing.assert_allclose(formed.drones[1].vel, [0.3, 0.0, 0.1], atol=0.01)
    moved(formed, "0 0 0 0", 1.5)
    formed.run(1.0)
    assert formed.phase is Phase.FORMATION  # let go of, it stands and no trajectory begins
    went = formed.drones[1].pos - start
    np.testing.assert_allclose(went, [0.6, 0.0, 0.2], atol=0.1)
    np.testing.assert_allclose(formed.drones[1].vel, 0.0, atol=0.01)
    np.testing.assert_allclose(formed.drones[2].pos - formed.drones[1].pos, [-0.4, 0.4, 0.0], atol=0.02)
    assert formed.reported.count(("moved", "lead")) == 1
    assert not formed.state.trajectory_started


@pytest.mark.parametrize("velocity", ["0.5 0 0 0", "-0.5 0.5 0 0", "0 -0.4 0.4 0", "0 0 -0.5 0", "0.3 0.3 0 1.0"])
def test_nobody_leaves_the_fence_nor_comes_down_wherever_it_is_flown(formed: FakeLab, velocity: str) -> None:
    for _ in range(160):
        moved(formed, velocity, 0.05)
        for drone in formed.drones.values():
            assert np.all(np.abs(drone.pos[:2]) < 1.5 - INSIDE_M)
            assert INSIDE_M < drone.pos[2] < 1.5 - INSIDE_M
            assert np.linalg.norm(drone.vel) < 0.55
    assert formed.phase is Phase.FORMATION


def test_a_turn_carries_the_slots_around_within_the_fence(formed: FakeLab) -> None:
    moved(formed, "0 0 0 0.5", 3.0)
    offset = formed.drones[2].pos - formed.drones[1].pos
    turned = np.arctan2(offset[1], offset[0]) - np.arctan2(0.4, -0.4)
    assert 1.0 < turned % (2.0 * np.pi) < 1.6


def test_the_last_event_lost_it_holds_within_a_third_of_a_second(formed: FakeLab) -> None:
    moved(formed, "0.4 0 0 0", 1.5)
    formed.run(HELD_NS * 1e-9 - 0.05)
    assert formed.phase is Phase.FORMATION
    formed.run(0.1)
    assert formed.phase is Phase.HOLD
    assert formed.causes[-1] is Cause.INPUT_LOST
    formed.run(1.5)
    assert all(np.linalg.norm(drone.vel) < 0.02 for drone in formed.drones.values())
    assert reasons(formed, Verb.RESUME) == [Reason.NOT_INTERRUPTED]
    accepted(formed, Verb.START)


def test_one_is_moved_in_hold_and_stays_clear_of_the_others() -> None:
    lab = FakeLab(triangle(leader=STAY, limits=FENCE))
    lab.take_off()
    for _ in range(160):  # straight at `left`, which hovers
        moved(lab, "-0.5 0.5 0 0", 0.05)
        assert np.linalg.norm(lab.drones[1].pos - lab.drones[2].pos) > 0.27
    assert lab.phase is Phase.HOLD
    assert reasons(lab, Verb.MOVE, "right 0.1 0 0 0") == [Reason.MOVED_ALREADY]
    lab.run(0.5)
    moved(lab, "0.2 0 0 0", 1.0, "right")
    lab.run(0.5)
    assert lab.phase is Phase.HOLD
    assert ("moved", "right") in lab.reported
    lab.run(1.0)
    assert np.linalg.norm(lab.drones[3].vel) < 0.02
    lab.land()


@pytest.mark.parametrize(
    ("argument", "reason"),
    [
        ("left 0.1 0 0 0", Reason.NOT_LEADER),
        ("wand 0.1 0 0 0", Reason.NO_DRONE),
        ("lead 0.1 0 0", Reason.NO_VELOCITY),
        ("lead nan 0 0 0", Reason.NO_VELOCITY),
        ("", Reason.NO_VELOCITY),
    ],
)
def test_what_is_refused_in_formation(formed: FakeLab, argument: str, reason: Reason) -> None:
    assert reasons(formed, Verb.MOVE, argument) == [reason]


def test_who_does_not_fly_is_not_moved_and_a_way_home_is_not_left() -> None:
    lab = FakeLab(triangle(leader=STAY))
    lab.run(2.0)
    assert reasons(lab, Verb.MOVE, "lead 0.1 0 0 0") == [Reason.OUT_OF_TURN]
    accepted(lab, Verb.EXCLUDE, "left")
    lab.fly()
    accepted(lab, Verb.HOME)
    assert reasons(lab, Verb.MOVE, "lead 0.1 0 0 0") == [Reason.LED_HOME]
    accepted(lab, Verb.HOLD)
    assert reasons(lab, Verb.MOVE, "left 0.1 0 0 0") == [Reason.NOT_FLYING]


def around(at_m=(0.0, 0.0, 0.5), others_m=(), slots_m=()) -> Surroundings:
    boxes = (np.array(points, float).reshape(-1, 3) for points in (others_m, slots_m))
    others, slots = boxes
    return Surroundings(np.array(at_m, float), others, 0.3, slots, Fence(), 0.0, 0.5)


def test_a_velocity_is_scaled_and_ends_where_there_is_no_room() -> None:
    assert limited((3.0, 4.0, 0.0, 9.0), around()) == (0.3, 0.4, 0.0, 1.0)
    assert limited((0.5, 0.0, 0.0, 0.0), around(at_m=(2.4, 0.0, 0.5))) == (0.0, 0.0, 0.0, 0.0)
    assert limited((-0.5, 0.0, 0.0, 0.0), around(at_m=(2.6, 0.0, 0.5))) == (-0.5, 0.0, 0.0, 0.0)
    assert limited((0.4, 0.3, 0.0, 0.0), around(others_m=(0.3, 0.0, 0.5))) == (0.0, 0.3, 0.0, 0.0)
    assert limited((0.5, 0.0, 0.0, 0.0), around(slots_m=(2.4, 0.0, 0.0))) == (0.0, 0.0, 0.0, 0.0)
    assert limited((0.0, 0.0, 0.0, 1.0), around(slots_m=(-1.0, 0.0, 0.0))) == (0.0, 0.0, 0.0, 0.5)
    assert limited((0.0, 0.0, 0.0, 1.0), around(at_m=(2.0, 0.0, 0.5), slots_m=(-1.0, 0.0, 0.0)))[3] == 0.0
    assert asked_of("a body 1 2 3 4") == ("a body", (1.0, 2.0, 3.0, 4.0))

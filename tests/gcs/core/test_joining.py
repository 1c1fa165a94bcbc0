"""A drone that stands ready joins in HOLD: it arms and rises alone, and forms with the others at the next start."""

import numpy as np
import pytest

from formation.codes import Cause
from formation.messages import Phase, Verb
from formation.reasons import Reason
from tests.gcs.core.test_taking_part import LEFT, RIGHT, nearest_m
from tests.gcs.fakes import STAY, FakeLab, G, accepted, reasons, triangle


@pytest.fixture
def lab() -> FakeLab:
    """Two fly, held; the third, left out before, stands ready under its slot."""
    lab = FakeLab(triangle(leader=STAY))
    lab.run(2.0)
    accepted(lab, Verb.EXCLUDE, "left")
    lab.fly()
    lab.run(4.0)
    accepted(lab, Verb.HOLD)
    lab.run(1.5)
    return lab


def others_moved_m(lab: FakeLab, seconds: float) -> float:
    """The most that any other moves meanwhile."""
    others = [lab.drones[1], lab.drones[RIGHT]]
    start, most = [drone.pos.copy() for drone in others], 0.0
    for _ in range(round(seconds * 100)):
        lab.step()
        most = max(most, *(float(np.linalg.norm(drone.pos - at)) for drone, at in zip(others, start, strict=True)))
    return most


def test_it_rises_alone_and_forms_with_the_others(lab: FakeLab) -> None:
    assert accepted(lab, Verb.INCLUDE, "left") == "phase HOLD, shape configured"
    assert reasons(lab, Verb.START) == [Reason.RISING]
    assert others_moved_m(lab, 8.0) < 0.02
    assert lab.phase is Phase.HOLD
    assert lab.events[-1] == "left has joined: `gcs start` leads on"
    np.testing.assert_allclose(lab.drones[LEFT].pos, [-0.4, 0.4, 0.3], atol=0.03)
    accepted(lab, Verb.START)
    assert nearest_m(lab, 500) > 0.3
    np.testing.assert_allclose(lab.drones[LEFT].pos - lab.drones[1].pos, [-0.4, 0.4, 0.0], atol=0.02)
    lab.land()
    assert lab.causes[-1] is Cause.LANDED


def _weak(drone) -> None:
    drone.hover *= 3.0  # full thrust does not lift it


def _refuses(drone) -> None:
    drone.rejects_arming = True


def _drifts(drone) -> None:
    advance = drone.advance

    def pushed(now_ns: int, dt_s: float) -> None:
        advance(now_ns, dt_s)
        if drone.pos[2] > 0.05 and drone.pos[1] < 0.6:
            drone.vel = drone.vel + dt_s * np.array([0.0, 1.5 * G, 0.0])

    drone.advance = pushed


@pytest.mark.parametrize(
    ("fault", "words"),
    [(_weak, "does not rise to its height"), (_refuses, "not armed"), (_drifts, "it drifts from where it rises")],
)
def test_one_that_fails_stays_down_alone_and_moves_nobody(lab: FakeLab, fault, words: str) -> None:
    fault(lab.drones[LEFT])
    accepted(lab, Verb.INCLUDE, "left")
    assert others_moved_m(lab, 20.0) < 0.02
    assert lab.phase is Phase.HOLD
    assert any(text.startswith("left does not join: ") and words in text for text in lab.events)
    assert not lab.drones[LEFT].armed
    assert [drone.excluded for drone in lab.state.drones] == [False, True, False]
    accepted(lab, Verb.START)
    lab.run(1.0)
    lab.land()


@pytest.mark.parametrize("verb", [Verb.LAND, Verb.STOP])
@pytest.mark.parametrize("after_s", [0.5, 1.6, 3.5])
def test_a_landing_or_a_stop_while_it_joins_is_for_it_too(lab: FakeLab, verb: Verb, after_s: float) -> None:
    accepted(lab, Verb.INCLUDE, "left")
    lab.run(after_s)
    lab.ask(verb)
    lab.run_until(Phase.GROUND if verb is Verb.LAND else Phase.STOPPED)
    lab.run(2.0)
    assert not any(drone.armed for drone in lab.drones.values())


def _carry(lab: FakeLab) -> None:
    lab.drones[LEFT].pos[:] = [-0.4, -0.2, 0.0]


def _hide(lab: FakeLab) -> None:
    lab.hidden.add("left")


def _arm(lab: FakeLab) -> None:
    lab.drones[LEFT].armed = True


def _switch_off(lab: FakeLab) -> None:
    lab.drones[LEFT].sends_nothing = True


@pytest.mark.parametrize(
    ("change", "found"),
    [
        (_carry, {Reason.NOT_CLEAR}),
        (_hide, {Reason.NO_POSE}),
        (_arm, {Reason.ARMED}),
        (_switch_off, {Reason.NO_HEARTBEAT}),
    ],
)
def test_who_is_not_ready_or_stands_under_another_is_refused(lab: FakeLab, change, found: set[Reason]) -> None:
    change(lab)
    lab.run(4.0)
    assert set(reasons(lab, Verb.INCLUDE, "left")) >= found
    lab.run(2.0)
    assert not lab.drones[LEFT].setpoints
    assert lab.phase is Phase.HOLD

import numpy as np
import pytest

from formation.reasons import Reason
from formation.safety import arming
from tests.formation.facts import LIMITS, healthy, of


def test_arming_a_healthy_swarm_is_not_refused():
    assert arming.prearm_failures(healthy(armed=np.zeros(3, bool), offboard=np.zeros(3, bool)), LIMITS) == ()


REFUSALS = {
    "never seen": ({"age_s": of(1, np.inf, 0.0)}, Reason.NO_POSE, "left: no fresh pose (last seen never)"),
    "stale": ({"age_s": of(0, 0.3, 0.0)}, Reason.NO_POSE, "lead: no fresh pose (last seen 0.3 s ago)"),
    "outside": (
        {"pos_lab_m": np.array([[0.0, 0, 0], [2.75, 0, 0], [0, 1, 0]])},
        Reason.OUTSIDE_FENCE,
        "left: 0.25 m outside the fence",
    ),
    "millimetres": (
        {"pos_lab_m": np.array([[0.0, 0, 0], [400.0, 0, 0], [0, 1, 0]])},
        Reason.OUTSIDE_FENCE,
        "left: 397.50 m outside the fence",
    ),
    "tilted": ({"tilt_rad": of(2, 1.0, 0.0)}, Reason.TILTED, "right: tilted by 57 degrees"),
    "carried": ({"speed_m_s": of(2, 0.5, 0.0)}, Reason.MOVING, "right: moving at 0.50 m/s"),
    "silent": ({"heartbeat_age_s": of(2, np.inf, 0.0)}, Reason.NO_HEARTBEAT, "right: no heartbeat (last heard never)"),
    "battery": ({"battery": of(2, 0.15, 1.0)}, Reason.BATTERY_LOW, "right: battery at 15%"),
    "duplicate": (
        {"duplicate": of(2, True, False)},
        Reason.SYSID_TWICE,
        "right: its sysid is used twice on the network",
    ),
}


@pytest.mark.parametrize("name", REFUSALS)
def test_arming_is_refused_with_the_reason(name):
    changes, reason, text = REFUSALS[name]
    (found,) = arming.prearm_failures(healthy(**changes), LIMITS)
    assert (found.reason, found.text) == (reason, text)


def test_two_drones_too_close_are_both_named():
    facts = healthy(pos_lab_m=np.array([[0.0, 0, 0], [0.1, 0, 0], [0, 1, 0]]))
    assert [found.text for found in arming.prearm_failures(facts, LIMITS)] == [
        "lead: 0.10 m from the next body, minimum is 0.20 m",
        "left: 0.10 m from the next body, minimum is 0.20 m",
    ]


def test_a_body_that_is_not_seen_keeps_nobody_else_on_the_floor():
    """Where it was, or the zeros it starts with, are no place: only the lack of its pose is told."""
    beside = np.array([[0.0, 0, 0], [0.1, 0, 0], [0, 1, 0]])
    facts = healthy(pos_lab_m=beside, age_s=of(0, np.inf, 0.0))
    assert arming.prearm_failures(facts, LIMITS) == (Reason.NO_POSE.of("lead", "never"),)

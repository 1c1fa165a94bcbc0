"""Each rule's limit, patience and measure, from both sides: a little less is let pass, a little more is told."""

import itertools

import numpy as np
import pytest

from formation.messages import Phase, Severity
from formation.safety.phases import Trigger
from formation.safety.rules import Facts, assess, nearest, outside_box, start, switched_on
from formation.safety.rules_table import RULE_NAMES
from tests.formation.facts import LIMITS, healthy, of


def at(*points: tuple[float, float, float]) -> dict[str, np.ndarray]:
    return {"pos_lab_m": np.array(points)}


def beside(gap_m: float) -> dict[str, np.ndarray]:
    return at((0.0, 0.0, 0.3), (-1.0, 1.0, 0.3), (-1.0, 1.0 - gap_m, 0.3))


def high(z: float) -> dict[str, np.ndarray]:
    return at((0.0, 0.0, 0.3), (-1.0, 1.0, z), (-1.0, -1.0, 0.3))


def level(name: str, less: float, more: float, well: float = 0.0) -> tuple[dict, dict]:
    return {name: of(1, less, well)}, {name: of(1, more, well)}


def flag(name: str, well: bool) -> tuple[dict, dict]:
    return {}, {name: of(1, not well, well)}


HEARD = level("silent_s", 2.99, 3.01)
FLYING = Phase.TAKEOFF


def both(own_m: float) -> dict[str, np.ndarray]:
    """A drone 0.6 m above the fence for the mocap, and where it believes itself."""
    own = np.full((3, 3), np.nan)
    own[1] = (-1.0, 1.0, own_m)
    return high(2.9) | {"own_pos_lab_m": own}


def upset(own_rad: float) -> dict[str, np.ndarray]:
    return {"tilt_rad": of(1, 1.5, 0.0), "own_tilt_rad": of(1, own_rad, np.nan)}


# words, (just not, just so), after s, in phase, trigger
LIMIT_OF = [
    ("body not seen for 0.2 s", level("age_s", 0.19, 0.21), 0.0, Phase.FORMATION, Trigger.HOLD),
    ("body not seen for 0.4 s", level("age_s", 0.39, 0.41), 0.0, FLYING, Trigger.LAND),
    ("body not seen for 5 s", level("age_s", 4.99, 5.01), 0.0, Phase.HOLD, Trigger.LAND),
    ("outside the fence", (high(2.29), high(2.31)), 0.1, Phase.LAND, Trigger.LAND),
    ("0.5 m outside the fence", (high(2.79), high(2.81)), 0.2, Phase.LAND, Trigger.LAND),
    ("closer than the minimum separation", (beside(0.21), beside(0.19)), 0.1, Phase.FORMATION, Trigger.HOLD),
    ("closer than half the minimum separation", (beside(0.11), beside(0.09)), 0.1, Phase.HOLD, Trigger.LAND),
    ("1 m away from its reference", level("error_m", 0.99, 1.01), 1.0, Phase.HOLD, Trigger.LAND),
    ("tilted by 75 degrees", level("tilt_rad", 1.29, 1.31), 0.3, Phase.ARMED, Trigger.LAND),
    ("0.5 m outside the fence, says its own estimate too", (both(2.79), both(2.81)), 0.2, Phase.LAND, Trigger.LAND),
    ("tilted by 75 degrees, says its own attitude too", (upset(1.29), upset(1.31)), 0.3, Phase.ARMED, Trigger.LAND),
    ("setpoints reach it 70 ms old", level("setpoint_age_s", 0.069, 0.071), 1.0, Phase.ARMED, None),
    ("setpoints reach it 70 ms old as it lands", level("setpoint_age_s", 0.069, 0.071), 1.0, Phase.LAND, None),
    ("setpoints reach it 100 ms old", level("setpoint_age_s", 0.099, 0.101), 1.0, Phase.HOLD, Trigger.LAND),
    ("nothing heard for 3 s", HEARD, 0.0, Phase.ARMED, Trigger.LAND),
    ("not in off-board mode", flag("offboard", True), 0.5, FLYING, Trigger.LAND),
    ("disarmed in the air", flag("armed", True), 0.3, FLYING, Trigger.LAND),
    ("battery low", level("battery", 0.21, 0.19, 1.0), 1.0, Phase.ARMED, None),
    ("battery empty", level("battery", 0.11, 0.09, 1.0), 1.0, Phase.ARMED, Trigger.LAND),
    ("model mismatch", level("model_mismatch", 0.37, 0.39), 0.3, Phase.LAND, None),
    (
        "its attitude is not the mocap's: late poses?",
        level("attitude_innovation_rad", 0.049, 0.051),
        0.1,
        Phase.LAND,
        Trigger.LAND,
    ),
    ("a fifth of the frames late", ({"late_share": 0.19}, {"late_share": 0.21}), 0.5, Phase.ARMED, None),
    ("seven tenths of the frames late", ({"late_share": 0.69}, {"late_share": 0.71}), 2.0, Phase.ARMED, Trigger.LAND),
    ("its sysid is used twice on the network", flag("duplicate", False), 0.0, Phase.GROUND, None),
]


def told(facts: Facts, phase: Phase, lasting_s: float) -> tuple[set[str], Trigger | None]:
    watch, first = assess(start(3), facts, phase, LIMITS, 5)
    _, then = assess(watch, facts, phase, LIMITS, 5 + round(lasting_s * 1e9))
    texts = {f.text.removeprefix("left: ").removeprefix("right: ") for f in (*first.changes, *then.changes)}
    return texts, then.trigger


@pytest.mark.parametrize(("words", "sides", "after_s", "phase", "trigger"), LIMIT_OF, ids=[r[0] for r in LIMIT_OF])
def test_a_limit_is_where_its_rule_says(words, sides, after_s, phase, trigger) -> None:
    less, more = sides
    assert words not in told(healthy(**less), phase, after_s + 9.0)[0]
    texts, then = told(healthy(**more), phase, after_s)
    assert words in texts
    assert then is trigger
    if after_s > 0.0:
        assert words not in told(healthy(**more), phase, after_s - 0.001)[0]


def test_points_outside_a_box_are_judged_along_their_worst_axis() -> None:
    points = np.array([[0.0, 0.0, 0.5], [1.2, 0.0, 0.5], [-1.5, 2.3, 0.5], [0.0, -2.1, 1.7], [0.0, 0.0, -0.4]])
    outside = outside_box(points, (-1.0, -2.0, 0.0), (1.0, 2.0, 1.0))
    np.testing.assert_allclose(outside, [0.0, 0.2, 0.5, 0.7, 0.4])


@pytest.mark.parametrize("seed", range(30))
def test_the_nearest_by_a_sweep_is_the_nearest_of_all_to_the_bit(seed: int) -> None:
    """Also with many at one place along an axis, and some in one point."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 80))
    points, known = rng.normal(size=(n, 3)) * rng.choice([0.0, 1.0, 9.0], 3), rng.random(n) < 0.9
    if seed % 3 == 0:
        points = np.round(points)
    np.testing.assert_array_equal(nearest(points, known), nearest_of_all(points, known))


def nearest_of_all(points: np.ndarray, known: np.ndarray) -> np.ndarray:
    """Every point against every other."""
    near = np.full(len(points), np.inf)
    for i, j in itertools.permutations(np.flatnonzero(known).tolist(), 2):
        x, y, z = points[i] - points[j]
        near[i] = min(near[i], np.sqrt(x * x + y * y + z * z))
    return near


def test_severity_follows_from_what_is_done() -> None:
    def severity(**changes) -> dict[str, Severity]:
        watch, first = assess(start(3), healthy(**changes), Phase.HOLD, LIMITS, 0)
        _, then = assess(watch, healthy(**changes), Phase.HOLD, LIMITS, 10**10)
        return {f.text: f.rule.severity for f in (*first.changes, *then.changes)}

    assert severity(battery=of(1, 0.15, 1.0)) == {"left: battery low": Severity.WARNING}
    assert severity(silent_s=of(1, 4.0, 0.0)) == {"left: nothing heard for 3 s": Severity.ERROR}
    assert severity(tilt_rad=of(1, 1.4, 0.0)) == {"left: tilted by 75 degrees": Severity.CRITICAL}


def test_each_rule_has_a_name_by_which_it_alone_is_switched_off() -> None:
    assert len(set(RULE_NAMES)) == len(RULE_NAMES)
    facts, on = healthy(tilt_rad=of(1, 1.5, 0.0)), switched_on(frozenset({"rule-tilted"}))
    watch, _ = assess(start(3), facts, Phase.HOLD, LIMITS, 0, on)
    assert assess(watch, facts, Phase.HOLD, LIMITS, 10**9, on)[1].trigger is None
    assert (~on).sum() == 1


@pytest.mark.parametrize("own", [{}, {"own_tilt_rad": of(1, 0.1, np.nan)}], ids=["silent", "contradicting"])
def test_motors_are_cut_only_where_the_second_witness_agrees(own) -> None:
    """A mocap that sees a level drone upside down lands it, and cuts nothing."""
    facts = healthy(tilt_rad=of(1, 3.1, 0.0), **own)
    watch, _ = assess(start(3), facts, Phase.HOLD, LIMITS, 0)
    _, verdict = assess(watch, facts, Phase.HOLD, LIMITS, 10**9)
    assert verdict.trigger is Trigger.LAND
    assert verdict.release.tolist() == [False, True, False]
    assert not verdict.cut.any()


def test_a_body_that_the_mocap_has_not_seen_is_no_witness() -> None:
    facts = healthy(tilt_rad=of(1, 1.5, 0.0), own_tilt_rad=of(1, 1.5, np.nan), age_s=of(1, 0.15, 0.0))
    watch, _ = assess(start(3), facts, Phase.HOLD, LIMITS, 0)
    assert not assess(watch, facts, Phase.HOLD, LIMITS, 10**9)[1].cut.any()


def test_the_lab_says_when_a_battery_is_low_and_when_it_is_empty() -> None:
    limits = LIMITS.model_copy(update={"battery_low_share": 0.5, "battery_empty_share": 0.3})
    said = []
    for charge in (0.51, 0.49, 0.29, np.nan):
        facts = healthy(battery=of(1, charge, 1.0))
        watch, _ = assess(start(3), facts, Phase.HOLD, limits, 0)
        _, verdict = assess(watch, facts, Phase.HOLD, limits, 10**9)
        said.append(({change.text for change in verdict.changes}, verdict.trigger))
    low = {"left: battery low"}
    assert said == [(set(), None), (low, None), ({*low, "left: battery empty"}, Trigger.LAND), (set(), None)]

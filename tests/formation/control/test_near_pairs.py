"""Pairs within reach: every pair that the filter would use is among them, against all pairs; far ones are not."""

import numpy as np
import pytest

from formation.control.limits.barriers import PAIR, _near
from formation.control.limits.near_pairs import Bodies, near_pairs

SEPARATION_M = 0.2


def swarm(seed: int) -> Bodies:
    """Any kind of bodies: crowded or far apart, slow or fast, with a velocity and an acceleration of all in common."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(2, 60))
    motion = np.zeros((n, 3, 3))
    motion[:, 0] = (
        rng.uniform(-1.0, 1.0, (n, 3)) * rng.choice([1.0, 5.0, 20.0]) * rng.choice([0.0, 1.0], 3, p=[0.2, 0.8])
    )
    motion[:, 1] = rng.normal(0.0, rng.choice([0.05, 1.0, 3.0]), (n, 3)) + rng.normal(0.0, 2.0, 3)
    motion[:, 2] = rng.normal(0.0, rng.choice([0.1, 1.0, 6.0]), (n, 3)) + rng.normal(0.0, 2.0, 3)
    acc, lost = np.clip(motion[:, 2] + rng.normal(0.0, 1.0, (n, 3)), -4.0, 4.0), rng.random(n) < 0.1
    unresponsive = rng.random(n) < 0.1
    return Bodies(
        motion, acc, np.where(lost, rng.uniform(0.0, 0.3, n), 0.0), rng.random(n) < 0.95, ~lost & (rng.random(n) < 0.8),
        ~unresponsive & (rng.random(n) < 0.8), unresponsive, lost,
    )  # fmt: skip


def all_pairs(bodies: Bodies) -> np.ndarray:
    """As the filter went through them before: each with each."""
    known, own = bodies.known, bodies.controllable
    pairs = [(a, b) for a in range(len(known)) for b in range(a) if known[a] and known[b] and (own[a] or own[b])]
    return np.array(pairs, np.int64).reshape(len(pairs), 2)


def used(bodies: Bodies, pairs: np.ndarray) -> tuple[bytes, bool]:
    """What the filter takes of these pairs, to the bit, and whether any is beyond its bound."""
    out = np.zeros(2 * len(pairs), PAIR)
    found, broken = _near(SEPARATION_M, bodies, pairs, out)
    return out[:found].tobytes(), broken


@pytest.mark.parametrize("seed", range(120))
def test_the_filter_takes_the_same_pairs_as_from_all_of_them(seed: int) -> None:
    bodies = swarm(seed)
    assert used(bodies, near_pairs(SEPARATION_M, bodies)) == used(bodies, all_pairs(bodies))


def test_these_swarms_have_pairs_that_count_and_pairs_that_do_not() -> None:
    swarms = [swarm(seed) for seed in range(120)]
    taken = sum(len(used(bodies, all_pairs(bodies))[0]) // PAIR.itemsize for bodies in swarms)
    reached, every = (sum(len(pairs) for pairs in map(of, swarms)) for of in (reaching, all_pairs))
    assert 1_000 < taken < reached < 0.7 * every


def reaching(bodies: Bodies) -> np.ndarray:
    return near_pairs(SEPARATION_M, bodies)


def resting(n: int) -> Bodies:
    """A row of bodies at rest, a metre apart, which all fly."""
    motion, yes, no = np.zeros((n, 3, 3)), np.ones(n, np.bool_), np.zeros(n, np.bool_)
    motion[:, 0, 0] = np.arange(n)[::-1]
    return Bodies(motion, np.zeros((n, 3)), np.zeros(n), yes, yes, yes, no, no)


def test_at_rest_the_reach_is_2_43_m_and_what_all_have_in_common_changes_nothing() -> None:
    """R = 1 + 20.01 / 6 = 4.335 m/s; (R^2 - 1) / 8 = 2.224 m, and a separation of 0.2 m: two neighbours each way."""
    bodies = resting(50)
    near = near_pairs(SEPARATION_M, bodies)
    assert near.tolist() == [[a, b] for a in range(50) for b in range(max(a - 2, 0), a)]
    bodies.motion[:, 1], bodies.motion[:, 2], bodies.acc_m_s2[:] = [2.0, 1.0, 0.5], [1.0, -2.0, 0.0], [1.0, -2.0, 0.0]
    np.testing.assert_array_equal(near_pairs(SEPARATION_M, bodies), near)


@pytest.mark.parametrize("field", [0, 1, 2])
@pytest.mark.parametrize("number", [np.nan, np.inf])
def test_a_number_that_is_none_hides_no_pair(field: int, number: float) -> None:
    bodies = resting(20)
    bodies.motion[7, field, 1] = number
    with np.errstate(invalid="ignore"):  # as plain Python numpy warns of what is meant here
        np.testing.assert_array_equal(near_pairs(SEPARATION_M, bodies), all_pairs(bodies))
    bodies.known[7] = False
    assert len(near_pairs(SEPARATION_M, bodies)) < 50


def test_one_alone_and_nobody_known_have_no_pairs() -> None:
    assert len(near_pairs(SEPARATION_M, resting(1))) == 0
    bodies = resting(3)
    bodies.known[:] = False
    assert len(near_pairs(SEPARATION_M, bodies)) == 0

"""Ways from shape to shape looked at by brute force: quintics and bumps in NumPy, all distances of all at 121 times."""

from math import sqrt

import numpy as np
import pytest

from formation.guidance.shape import Shape
from formation.guidance.trajectory import braking_s, closing_s
from formation.guidance.transition import Space, transition
from tests.formation.oracles.guidance import STEP

SPACE = Space(min_separation_m=0.2, clearance_m=0.32, low_m=-0.8, high_m=2.5, speed_m_s=0.7)
U = np.linspace(0.0, 1.0, 121)
RISES = (1.5, -1.5, 2.0, -2.0, 3.0, -3.0, 4.0, 5.0, 1.0, -1.0)


def paths(start: np.ndarray, goal: np.ndarray, rise: np.ndarray) -> np.ndarray:
    """Of leader and followers (n + 1, 121, 3): minimum jerk, and 64 u^3 (1 - u)^3 of the rise."""
    straight = goal[:, None] + (start - goal)[:, None] * (1.0 - STEP(U))[None, :, None]
    straight[:, :, 2] += rise[:, None] * 64.0 * (U * (1.0 - U)) ** 3
    return np.concatenate([np.zeros((1, 121, 3)), straight])


def apart(at: np.ndarray) -> float:
    distances = np.linalg.norm(at[:, None] - at[None], axis=-1).min(axis=2)
    np.fill_diagonal(distances, np.inf)
    return float(distances.min())


def shape(goal: np.ndarray) -> Shape:
    return Shape("S", tuple((float(x), float(y), float(z)) for x, y, z in goal), (0.0,) * len(goal))


def at_rest(start: np.ndarray) -> np.ndarray:
    motion = np.zeros((len(start), 3, 4))
    motion[:, 0, :3] = start
    return motion


def lasts(start: np.ndarray, goal: np.ndarray, rise: np.ndarray) -> float:
    """Peak speeds 1.875 d and 3.4346 h, peak accelerations 5.7735 d and 24 h of unit steps and bumps, 2.5 m/s^2."""
    d, h = np.linalg.norm(start - goal, axis=1), np.abs(rise)
    by_speed, by_acceleration = (1.875 * d + 3.4346 * h) / 0.7, np.sqrt((5.7735 * d + 24.0 * h) / 2.5)
    return float(np.max(np.maximum(np.maximum(by_speed, by_acceleration), 0.6)))


@pytest.mark.parametrize(
    ("y", "low", "high"), [(0.05, -0.8, 2.5), (0.05, -0.8, 0.3), (0.2, -0.1, 1.3), (-0.1, -0.7, 0.4)]
)
def test_one_who_crosses_the_leader_takes_the_first_best_rise(y: float, low: float, high: float) -> None:
    start, goal = np.array([[1.0, y, 0.1]]), np.array([[-1.2, 0.0, 0.0]])
    space = Space(0.2, 0.32, low, high, 0.7)
    found = {}
    for rise in RISES:
        way = paths(start, goal, np.array([0.32 * rise]))
        if way[1, :, 2].min() >= min(low, 0.0) and way[1, :, 2].max() <= max(high, 0.1):
            found[rise] = min(apart(way), 0.32)
    best = max(found, key=lambda rise: found[rise])
    made = transition(shape(goal), at_rest(start), space, ["L", "A"])
    assert made.rise_m == pytest.approx((0.32 * best,))
    assert made.separation_m == pytest.approx(apart(paths(start, goal, np.array(made.rise_m))))
    assert made.duration_s == pytest.approx(lasts(start, goal, np.array(made.rise_m)))


@pytest.mark.parametrize("seed", range(10))
def test_what_is_told_of_a_way_is_what_is_flown(seed: int) -> None:
    rng = np.random.default_rng(seed)
    ring = np.column_stack([np.cos([0.3, 1.7, 3.1, 4.6]), np.sin([0.3, 1.7, 3.1, 4.6]), np.zeros(4)])
    start, goal = ring + 0.1 * rng.normal(size=(4, 3)), -ring[rng.permutation(4)] * 0.9
    made = transition(shape(goal), at_rest(start), SPACE, ["L", "A", "B", "C", "D"])
    rise = np.array(made.rise_m)
    assert made.separation_m == pytest.approx(apart(paths(start, goal, rise)))
    assert made.separation_m >= 0.2
    assert made.duration_s == pytest.approx(lasts(start, goal, rise))
    if rise.any():
        assert made.separation_m > apart(paths(start, goal, np.zeros(4)))


def test_a_way_that_is_clear_is_straight() -> None:
    start = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    made = transition(shape(1.4 * start), at_rest(start), SPACE, ["L", "A", "B"])
    assert made.rise_m == (0.0, 0.0)


def test_closing_takes_as_long_as_speed_acceleration_turn_and_braking_need() -> None:
    def gap(**rows: list[float]) -> np.ndarray:
        out = np.zeros((4, 4))
        for name, row in rows.items():
            out["pvah".index(name)] = row
        return out

    def closing(gap: np.ndarray, speed: float) -> float:
        return closing_s(gap, braking_s(gap), speed)

    assert closing(gap(p=[3.0, 4.0, 0.0, 0.0]), 1.5) == pytest.approx(1.875 * 5.0 / 1.5)
    assert closing(gap(p=[0.3, 0.0, 0.4, 0.0]), 9.0) == pytest.approx(sqrt(5.7735 * 0.5 / 2.5))
    assert closing(gap(p=[0.0, 0.0, 0.0, -2.0]), 9.0) == pytest.approx(1.875 * 2.0)
    assert closing(gap(h=[0.0, 0.0, 1.0, 0.0]), 0.5) == pytest.approx(3.4346 / 0.5)
    assert closing(gap(p=[1.0, 0.0, 0.0, 0.0], h=[0.0, 0.0, 1.0, 0.0]), 9.0) == pytest.approx(sqrt(29.7735 / 2.5))
    moving = gap(v=[2.0, 1.0, 2.0, 0.5])
    assert braking_s(moving) == pytest.approx(2.0 * 3.0 / 2.5)
    # It is braked along Hermite's cubic: half the speed times the time, plus a twelfth of the acceleration's share.
    braked = gap(v=[2.0, 1.0, 2.0, 0.0], a=[0.5, -0.5, 1.0, 0.0])
    ahead = 2.4 * (0.5 * np.array([2.0, 1.0, 2.0]) + np.array([0.5, -0.5, 1.0]) * 2.4 / 12.0)
    assert closing(braked, 0.4) == pytest.approx(1.875 * np.linalg.norm(ahead) / 0.4)

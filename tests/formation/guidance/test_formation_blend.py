"""The gap that closes: continuous from any motion, at rest at its end, and no passing motion runs on."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from formation.guidance.blend import ACCELERATION_M_S2, add_gap, braked, braking_s, closing_s, stopping_s

numbers = st.lists(st.floats(-3.0, 3.0), min_size=16, max_size=16)


def at(gap: np.ndarray, t_s: float, duration_s: float) -> np.ndarray:
    out = np.zeros((3, 4))
    add_gap(gap, braking_s(gap), t_s, duration_s, out)
    return out


@given(numbers, st.floats(0.05, 0.95))
def test_it_begins_with_the_gap_ends_with_none_and_its_rates_are_its_slopes(values: list[float], share: float) -> None:
    gap = np.array(values).reshape(4, 4)
    duration_s = closing_s(gap, braking_s(gap), 0.4)
    np.testing.assert_allclose(at(gap, 0.0, duration_s), gap[:3], atol=1e-9)
    np.testing.assert_allclose(at(gap, duration_s * (1.0 - 1e-9), duration_s), 0.0, atol=1e-6)
    t_s, h_s = share * duration_s, 1e-5
    before, after, here = (at(gap, t_s + d, duration_s) for d in (-h_s, h_s, 0.0))
    np.testing.assert_allclose((after[0] - before[0]) / (2.0 * h_s), here[1], atol=1e-4)
    np.testing.assert_allclose((after[1] - before[1]) / (2.0 * h_s), here[2], atol=1e-2)


@pytest.mark.parametrize("distance_m", [0.5, 1.5, 3.0])
def test_a_climb_taken_over_at_speed_does_not_overshoot(distance_m: float) -> None:
    """1.5 m below its goal and rising at 0.5 m/s: slowly there is no reason to go above it."""
    gap = np.zeros((4, 4))
    gap[0, 2], gap[1, 2], gap[2, 2] = -distance_m, 0.5, 2.0
    duration_s = closing_s(gap, braking_s(gap), 0.4)
    assert max(at(gap, t_s, duration_s)[0, 2] for t_s in np.linspace(0.0, duration_s, 200)) < 1e-9


def test_what_is_left_open_is_braked_within_the_gentle_acceleration() -> None:
    gap = np.zeros((4, 4))
    gap[1, 0] = 2.0
    brake_s = braking_s(gap)
    gap[0, 0] = -braked(gap, 0, brake_s)
    assert closing_s(gap, brake_s, 0.4) == brake_s
    assert -gap[0, 0] == pytest.approx(0.5 * 2.0 * brake_s)
    peak = max(np.abs(at(gap, t_s, brake_s)[2, 0]) for t_s in np.linspace(0.0, brake_s, 100))
    assert peak <= ACCELERATION_M_S2 * 1.01


def test_heading_is_no_part_of_the_distance_that_speed_bounds() -> None:
    gap = np.zeros((4, 4))
    gap[0] = 0.6, -0.3, 0.2, 0.0
    straight_s = closing_s(gap, braking_s(gap), 0.4)
    assert straight_s == pytest.approx(15.0 / 8.0 * 0.7 / 0.4)  # the quintic's peak speed is 15/8 of the mean
    gap[0, 3] = 0.5
    assert closing_s(gap, braking_s(gap), 0.4) == straight_s


def test_what_has_little_room_is_braked_harder_and_never_harder_than_a_tilt_can() -> None:
    gap = np.zeros((4, 4))
    gap[1, 2] = -1.5
    far, near, none = (np.array([9.0, 9.0, room_m]) for room_m in (2.0, 0.6, 0.0))
    assert stopping_s(gap, far) == braking_s(gap) == pytest.approx(1.2)
    assert stopping_s(gap, near) == pytest.approx(0.8)  # 0.6 m at a mean of 0.75 m/s
    hardest_s = stopping_s(gap, none)
    track = np.array([at_braked(gap, hardest_s, t_s)[2, 2] for t_s in np.linspace(0.0, hardest_s, 200)])
    assert np.abs(track).max() == pytest.approx(4.0, rel=0.02)


def at_braked(gap: np.ndarray, brake_s: float, t_s: float) -> np.ndarray:
    """Of a gap whose distance is all braked away."""
    resting = gap.copy()
    resting[0] = [-braked(gap, column, brake_s) for column in range(4)]
    out = np.zeros((3, 4))
    add_gap(resting, brake_s, t_s, brake_s * 1.001, out)
    return out

"""The swept fan and the wind: where they push, when, and how hard."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from formation.disturbance import STILL, Disturbance, SweptFan, acceleration, fan_acceleration, fan_heading_rad

FAN = SweptFan(peak_m_s2=2.0)
HERE = (0.0, 0.0, 0.3)


def test_the_fan_sweeps_eighty_degrees_to_both_sides_in_four_seconds() -> None:
    headings = np.array([fan_heading_rad(FAN, t) for t in np.linspace(0.0, 4.0, 401)])
    assert np.degrees(headings.max() - np.pi) == pytest.approx(80.0)
    assert np.degrees(headings.min() - np.pi) == pytest.approx(-80.0)
    assert headings[0] == pytest.approx(headings[-1])


def test_the_push_on_the_axis_is_the_peak_away_from_the_fan() -> None:
    assert fan_acceleration(FAN, 0.0, HERE) == pytest.approx((-2.0, 0.0, 0.0))
    # A free jet's speed falls as 1 / distance, its push as the square.
    assert fan_acceleration(FAN, 0.0, (-0.5, 0.0, 0.3)) == pytest.approx((-0.5, 0.0, 0.0))


def test_the_push_off_the_axis_is_a_gaussian_of_the_angle() -> None:
    angle = FAN.spread_rad
    aside = (0.5 - 0.5 * np.cos(angle), 0.5 * np.sin(angle), 0.3)
    assert np.hypot(*fan_acceleration(FAN, 0.0, aside)[:2]) == pytest.approx(2.0 * np.exp(-2.0))
    assert np.linalg.norm(fan_acceleration(FAN, 1.0, HERE)) < 1e-6


def test_a_gust_comes_twice_a_period() -> None:
    push = np.array([-fan_acceleration(FAN, t, HERE)[0] for t in np.arange(0.0, 4.0, 0.01)])
    strong = push > 1.0
    assert np.sum(strong & ~np.roll(strong, 1)) == 2
    assert push.max() == pytest.approx(2.0, rel=1e-3)


def test_nothing_before_the_fan_is_switched_on() -> None:
    late = SweptFan(start_s=5.0)
    assert fan_acceleration(late, 4.999, HERE) == STILL
    assert fan_acceleration(late, 8.0, HERE)[0] < -1.0


def test_wind_and_fan_add_up() -> None:
    both = Disturbance(wind_lab_m_s2=(0.1, 0.2, 0.3), fan=FAN)
    assert acceleration(both, 0.0, HERE) == pytest.approx((-1.9, 0.2, 0.3))
    assert acceleration(Disturbance(wind_lab_m_s2=(0.1, 0.0, 0.0)), 9.0, HERE) == (0.1, 0.0, 0.0)
    assert Disturbance().is_still
    assert not both.is_still


@given(st.floats(-100.0, 100.0), st.tuples(*[st.floats(-3.0, 3.0)] * 3))
def test_the_push_is_finite_and_bounded_everywhere(t_s: float, pos: tuple[float, float, float]) -> None:
    strongest = FAN.peak_m_s2 * (FAN.reference_m / FAN.core_m) ** 2
    assert np.linalg.norm(fan_acceleration(FAN, t_s, pos)) <= strongest * (1.0 + 1e-9)

"""The swept fan and the wind: where they push, when, and how hard."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drone_agent.simulation.disturbance import (
    STILL,
    Disturbance,
    SweptFan,
    acceleration,
    fan_acceleration,
    fan_heading_rad,
    jet_speed,
)

FAN = SweptFan(peak_m_s2=2.0)
HERE = (0.0, 0.0, 0.3)


def test_the_fan_sweeps_eighty_degrees_to_both_sides_in_four_seconds() -> None:
    headings = np.array([fan_heading_rad(FAN, t) for t in np.linspace(0.0, 4.0, 401)])
    assert np.degrees(headings.max() - np.pi) == pytest.approx(80.0)
    assert np.degrees(headings.min() - np.pi) == pytest.approx(-80.0)
    assert headings[0] == pytest.approx(headings[-1])


def test_the_push_on_the_axis_is_the_peak_away_from_the_fan() -> None:
    assert fan_acceleration(FAN, 0.0, HERE) == pytest.approx((-2.0, 0.0, 0.0))
    assert fan_acceleration(FAN, 0.0, (0.6, 0.0, 0.3)) == STILL


def test_the_jet_is_albertsons() -> None:
    """Full speed in a core that ends after 6.2 diameters, 6.2 D / x on the axis beyond, and a Gaussian of the side."""
    assert jet_speed(6.1, 0.0, 1.0) == 1.0
    assert jet_speed(20.0, 0.0, 1.0) == pytest.approx(6.17 / 20.0, rel=1e-3)
    assert jet_speed(20.0, 0.081 * 20.0, 1.0) == pytest.approx(6.17 / 20.0 * np.exp(-0.5), rel=1e-3)
    # The speed is half where r = 1.177 sigma; near the fan that counts from the core's edge.
    assert jet_speed(2.0, 0.5 - 0.162 + 1.177 * 0.162, 1.0) == pytest.approx(0.5, rel=1e-3)
    assert jet_speed(-0.1, 0.0, 1.0) == 0.0


def test_the_jet_turns_away() -> None:
    assert np.linalg.norm(fan_acceleration(FAN, 1.0, HERE)) < 1e-6


def test_a_vehicle_is_pushed_at_its_four_rotors() -> None:
    fan, t_s = Disturbance(fan=FAN), 0.17
    corners = [fan_acceleration(FAN, t_s, (x, y, 0.3)) for x in (-0.04, 0.04) for y in (-0.04, 0.04)]
    assert acceleration(fan, t_s, HERE, 0.04) == pytest.approx(np.mean(corners, axis=0))
    assert acceleration(fan, t_s, HERE) == pytest.approx(fan_acceleration(FAN, t_s, HERE))


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
    assert np.linalg.norm(fan_acceleration(FAN, t_s, pos)) <= FAN.peak_m_s2 * (1.0 + 1e-9)

"""The physics: the attitude loop, the swept fan and the wind."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import curve_fit

from drone_agent.guard.position import LoopSetpoint
from drone_agent.simulation.attitude_loop import advance
from drone_agent.simulation.disturbance import (
    Disturbance,
    SweptFan,
    acceleration,
    fan_heading_rad,
    jet_speed,
)
from formation.maths import frames
from formation.maths.arrays import Float
from formation.vehicle.profile import PROFILES, VehicleProfile, VehicleState, at_rest, on_ground, profile

CALM = np.zeros(3)
PAPER = profile("paper_40g")


def level(norm: float) -> LoopSetpoint:
    return LoopSetpoint(frames.IDENTITY, np.zeros(3), norm)


def hovering(body: VehicleProfile, height_m: float = 1.0) -> VehicleState:
    return at_rest(np.array([0.0, 0.0, height_m]), frames.IDENTITY, 0.25 * body.weight_n)


@pytest.mark.parametrize("name", sorted(PROFILES))
def test_hover_thrust_hovers(name: str) -> None:
    body = PROFILES[name].model_copy(update={"ground_effect": 0.0})
    end = advance(hovering(body), body, level(body.hover_thrust_norm), True, CALM, 0.001, 2000)
    np.testing.assert_allclose(end.pos_lab_m, [0.0, 0.0, 1.0], atol=1e-6)


def test_takes_off_only_above_its_weight_and_lands_again() -> None:
    state = at_rest(np.zeros(3), frames.IDENTITY)
    state = advance(state, PAPER, level(0.9 * PAPER.hover_thrust_norm), True, CALM, 0.001, 1000)
    assert on_ground(state)
    state = advance(state, PAPER, level(1.1 * PAPER.hover_thrust_norm), True, CALM, 0.001, 500)
    assert state.pos_lab_m[2] > 0.1
    state = advance(state, PAPER, level(0.0), True, CALM, 0.001, 3000)
    assert on_ground(state)
    assert frames.rotate(state.q_lab_from_flu, np.array([0.0, 0.0, 1.0]))[2] > 0.999


def test_too_long_a_step_is_refused() -> None:
    with pytest.raises(ValueError, match="step"):
        advance(hovering(PAPER), PAPER, level(0.5), True, CALM, 0.01, 1)


FAN = SweptFan(peak_m_s2=2.0)
BLOWN = Disturbance(fan=FAN)
HERE = (0.0, 0.0, 0.3)


def test_the_fan_sweeps_eighty_degrees_to_both_sides_in_four_seconds() -> None:
    headings = np.array([fan_heading_rad(BLOWN.air, t) for t in np.linspace(0.0, 4.0, 401)])
    assert np.degrees(headings.max() - np.pi) == pytest.approx(80.0)
    assert np.degrees(headings.min() - np.pi) == pytest.approx(-80.0)
    assert headings[0] == pytest.approx(headings[-1])


def test_the_push_on_the_axis_is_the_peak_away_from_the_fan() -> None:
    assert acceleration(BLOWN, 0.0, HERE) == pytest.approx((-2.0, 0.0, 0.0))
    assert not acceleration(BLOWN, 0.0, (0.6, 0.0, 0.3)).any()


def test_the_jet_is_albertsons() -> None:
    """Full speed in a core that ends after 6.2 diameters, 6.2 D / x on the axis beyond, and a Gaussian of the side."""
    assert jet_speed(6.1, 0.0, 1.0) == 1.0
    assert jet_speed(20.0, 0.0, 1.0) == pytest.approx(6.17 / 20.0, rel=1e-3)
    assert jet_speed(20.0, 0.081 * 20.0, 1.0) == pytest.approx(6.17 / 20.0 * np.exp(-0.5), rel=1e-3)
    # The speed is half where r = 1.177 sigma; near the fan that counts from the core's edge.
    assert jet_speed(2.0, 0.5 - 0.162 + 1.177 * 0.162, 1.0) == pytest.approx(0.5, rel=1e-3)
    assert jet_speed(-0.1, 0.0, 1.0) == 0.0


def test_a_vehicle_is_pushed_at_its_four_rotors() -> None:
    t_s = 0.17
    corners = [acceleration(BLOWN, t_s, (x, y, 0.3)) for x in (-0.04, 0.04) for y in (-0.04, 0.04)]
    assert acceleration(BLOWN, t_s, HERE, 0.04) == pytest.approx(np.mean(corners, axis=0))


@given(st.floats(-100.0, 100.0), st.tuples(*[st.floats(-3.0, 3.0)] * 3))
def test_the_push_is_finite_and_bounded_everywhere(t_s: float, pos: tuple[float, float, float]) -> None:
    assert np.linalg.norm(acceleration(BLOWN, t_s, pos)) <= FAN.peak_m_s2 * (1.0 + 1e-9)


def test_px4_answers_as_measured() -> None:
    """PX4 v1.16 SIH: 0.11 s dead time and 0.06 s lag from target to attitude fit to within 5 %."""
    body = profile("px4_quad")
    tilt = 0.1
    target = LoopSetpoint(frames.from_rotation_vector(np.array([0.0, tilt, 0.0])), np.zeros(3), body.hover_thrust_norm)
    state, angles = hovering(body, 5.0), []
    for _ in range(400):
        state = advance(state, body, target, True, CALM, 0.001, 1)
        angles.append(2.0 * np.arcsin(state.q_lab_from_flu[2]) / tilt)
    t_s = np.arange(1, 401) * 0.001 + body.command_delay_s

    def response(t: Float, dead_s: float, lag_s: float) -> Float:
        return np.where(t > dead_s, 1.0 - np.exp(-np.maximum(t - dead_s, 0.0) / lag_s), 0.0)

    (dead_s, lag_s), _ = curve_fit(response, t_s, np.array(angles), p0=(0.1, 0.05))
    assert dead_s == pytest.approx(body.response_dead_time_s, abs=0.005)
    assert lag_s == pytest.approx(body.response_lag_s, abs=0.005)

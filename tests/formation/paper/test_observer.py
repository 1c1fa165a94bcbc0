"""The FTESO of Eqs. (3)-(4): against a fine explicit integration, and by what it makes of noise and disturbances."""

from math import cos, sin

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from formation.estimation.heading import wrapped
from formation.estimation.observers import adaptive_gain, extrapolation_error
from formation.estimation.response import rate_step
from formation.paper.eq34_observer import fteso_step
from tests.formation.oracles.powers import fteso_backward, fteso_rate

GAINS = [(70.0, -2.0 / 9.0, 1.0, 0.0), (15.0, -0.1, 0.004, 1.0), (11.0, -0.3, 0.02, 0.5)]


def push(t: float) -> float:
    return 1.3 + 0.8 * np.sin(3.0 * t)


def place(t: float) -> float:
    return 0.02 * np.cos(4.0 * t) + 0.05 * t


@pytest.mark.parametrize("gains", GAINS)
def test_small_steps_follow_eqs_3_and_4(gains: tuple[float, float, float, float]) -> None:
    """Z1' = Z2 + 3 w sig^(1+a), Z2' = Z3 + 3 w^2 sig^(1+2a) + g u + f, Z3' = w^3 sig^(1+3a), from far off."""
    z = stepped = np.array([0.05, -0.3, 0.7])
    dt, fine = 2e-4, 20
    for k in range(1000):
        t = k * dt
        for j in range(fine):
            s = t + j * dt / fine
            z = z + dt / fine * fteso_rate(z, place(s), push(s), *gains)
        stepped = np.array(fteso_step(*stepped, push(t + 0.5 * dt), place(t + dt), dt, *gains))
        if k in (200, 500):
            assert (np.abs(stepped - z) < 0.03 * np.abs(z) + [1e-4, 0.01, 0.08]).all()
    assert (np.abs(stepped - z) < 0.01 * np.abs(z) + [1e-5, 0.01, 0.1]).all()


@pytest.mark.parametrize("gains", GAINS)
def test_any_step_is_the_backward_euler_step_of_eqs_3_and_4(gains: tuple[float, float, float, float]) -> None:
    """b1 = 3 w, b2 = 3 w^2, b3 = w^3, each correction taken at the error that it leaves."""
    rng = np.random.default_rng(3)
    for _ in range(60):
        z, y, u, dt = rng.normal(size=3), rng.normal(), 3.0 * rng.normal(), rng.uniform(0.001, 0.05)
        expected = fteso_backward(z, y, u, dt, *gains)
        np.testing.assert_allclose(fteso_step(*z, u, y, dt, *gains), expected, rtol=1e-9, atol=1e-9)


def test_an_alpha_beta_filter_has_both_poles_where_its_bandwidth_says() -> None:
    """Error dynamics of x, rate: the characteristic polynomial is (z - exp(-w dt))^2."""
    w, dt, columns = 12.0, 0.02, []
    for x, rate in ((1.0, 0.0), (0.0, 1.0)):
        columns.append(rate_step(x, rate, 0.0, dt, w, 0.0))
    trace, determinant = columns[0][0] + columns[1][1], columns[0][0] * columns[1][1] - columns[1][0] * columns[0][1]
    pole = np.exp(-w * dt)
    assert (trace, determinant) == pytest.approx((2.0 * pole, pole**2))


def test_the_rate_of_an_alpha_beta_filter_decays() -> None:
    assert rate_step(0.0, 1.0, 0.05, 0.05, 12.0, 7.0)[1] == pytest.approx(np.exp(-7.0 * 0.05))


PRINTED = (70.0, -2.0 / 9.0, 1.0, 0.0)


def observe(gains: tuple[float, float, float, float], dt_s: float, duration_s: float, dist: float) -> list[float]:
    """Errors of Z3 on a point pushed by a known constant acceleration, measured without noise."""
    z1, z2, z3, errors = 0.0, 0.0, 0.0, []
    for k in range(1, int(duration_s / dt_s)):
        t = k * dt_s
        z1, z2, z3 = fteso_step(z1, z2, z3, 0.0, 0.5 * dist * t * t, dt_s, *gains)
        errors.append(abs(z3 - dist))
    return errors


@pytest.mark.parametrize("rate_hz", [50.0, 100.0, 240.0])
@pytest.mark.parametrize("gains", [PRINTED, (18.0, -0.1, 0.004, 1.0), (18.0, -0.3, 0.004, 0.0)])
def test_z3_finds_a_constant_push_in_finite_time(gains: tuple[float, float, float, float], rate_hz: float) -> None:
    errors = observe(gains, 1.0 / rate_hz, 3.0, 2.5)
    assert max(errors[int(1.5 * rate_hz) :]) < 1e-3 * 2.5


@given(st.floats(-0.33, -0.01), st.floats(5.0, 200.0), st.floats(1e-3, 1.0), st.floats(0.002, 0.2))
def test_the_observer_never_diverges(alpha: float, w: float, scale: float, dt_s: float) -> None:
    z1, z2, z3 = 1.0, -2.0, 5.0
    for _ in range(200):
        z1, z2, z3 = fteso_step(z1, z2, z3, 0.0, 0.0, dt_s, w, alpha, scale, 0.0)
    assert abs(z1) <= 1e4
    assert np.isfinite([z2, z3]).all()


def test_a_step_without_correction_is_newtons_law() -> None:
    z1, z2, z3 = fteso_step(1.0, 2.0, 0.5, 1.5, 1.0 + 0.02 + 0.5 * 2.0 * 1e-4, 0.01, 18.0, -0.1, 0.004, 1.0)
    assert (z1, z2, z3) == pytest.approx((1.0201, 2.02, 0.5), abs=1e-12)


def test_rate_step_finds_a_slope() -> None:
    x, rate = 0.0, 0.0
    for k in range(200):
        x, rate = rate_step(x, rate, 0.3 * (k + 1) * 0.01, 0.01, 30.0, 0.0)
    assert rate == pytest.approx(0.3, abs=1e-6)


@given(st.floats(-50.0, 50.0))
def test_wrapped_is_the_same_angle(angle: float) -> None:
    w = wrapped(angle)
    assert -np.pi <= w < np.pi + 1e-12
    assert (cos(w), sin(w)) == pytest.approx((cos(angle), sin(angle)), abs=1e-9)


def test_extrapolation_error_ignores_parabolas_and_knows_its_gain() -> None:
    times = np.array([-0.031, -0.019, -0.011])
    values = 1.0 + 2.0 * times - 3.0 * times**2
    error, gain = extrapolation_error(times, values, 0.0, 1.0)
    assert error == pytest.approx(0.0, abs=1e-12)
    # Even spacing: y - 3 y1 + 3 y2 - y3, variance 1 + 9 + 9 + 1.
    _, even = extrapolation_error(np.array([-0.03, -0.02, -0.01]), values, 0.0, 1.0)
    assert even == pytest.approx(20.0)
    assert gain > 1.0


def test_activity_is_calm_in_noise_and_bounded() -> None:
    assert adaptive_gain(0.0, 1e-4, 5.0) == 1.0
    assert adaptive_gain(3e-4, 1e-4, 5.0) == pytest.approx(10.0**0.5)
    assert adaptive_gain(1.0, 1e-4, 5.0) == 5.0

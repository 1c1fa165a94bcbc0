from math import cos, sin

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from formation.estimation.adaptive_gain import adaptive_gain, extrapolation_error
from formation.estimation.fteso import fteso_step
from formation.estimation.heading import wrapped
from formation.estimation.leader import rate_step

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

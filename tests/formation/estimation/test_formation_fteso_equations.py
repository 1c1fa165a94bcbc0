"""The FTESO of Eqs. (3)-(4), held against a fine explicit integration of the differential equation."""

import numpy as np
import pytest
from oracle_powers import fteso_backward, fteso_rate

from formation.estimation.fteso import fteso_step
from formation.estimation.leader import rate_step

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

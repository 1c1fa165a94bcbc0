"""Eqs. (5) and (6) held against their own differential equation."""

from math import exp

import numpy as np
import pytest

from formation.paper.eq56_super_twisting import (
    equivalent_and_reaching,
    sliding_variable,
    super_twisting,
    super_twisting_rate,
    switching,
)
from tests.formation.oracles.powers import sig, super_twisting_backward

PRINTED = (8.0, 0.1, -0.49, 0.0)
OURS = (2.9, 0.5, -0.177, 0.057)
STRONG = (6.0, 9.0, -0.3, 0.2)


def test_the_sliding_variable_is_eq_5() -> None:
    assert sliding_variable(3.0, 0.2, -0.7) == pytest.approx(3.0 * 0.2 - 0.7)


@pytest.mark.parametrize("gains", [PRINTED, OURS, STRONG])
def test_small_steps_follow_eq_6(gains: tuple[float, float, float, float]) -> None:
    """t_m = p1 sig(s)^(1+eps) + z_m, z_m' = p2 sig(s)^(1+2 eps), round a loop s' = push - t_m."""
    p1, p2, eps, smooth = gains
    dt, fine = 1e-3, 50
    s, z = 0.8, 0.3
    stepped_s, stepped_z = s, z
    for k in range(300):
        push = 0.6 * np.sin(5.0 * k * dt)
        for _ in range(fine):
            t_m = p1 * sig(s, 1.0 + eps, smooth) + z
            z += dt / fine * p2 * sig(s, 1.0 + 2.0 * eps, smooth)
            s += dt / fine * (push - t_m)
        t_m, stepped_z = super_twisting(stepped_s, stepped_z, p1, p2, eps, smooth, dt)
        stepped_s += dt * (push - t_m)
        assert stepped_s == pytest.approx(s, abs=0.02)
        assert stepped_z == pytest.approx(z, rel=0.01, abs=0.005)


@pytest.mark.parametrize("gains", [PRINTED, OURS, STRONG])
def test_any_step_is_the_backward_euler_step_of_eq_6(gains: tuple[float, float, float, float]) -> None:
    """The inner power is 1 + 2 eps, the outer 1 + eps."""
    rng = np.random.default_rng(5)
    for _ in range(60):
        s, z, dt = rng.normal(), rng.normal(), rng.uniform(0.002, 0.1)
        assert super_twisting(s, z, *gains, dt) == pytest.approx(super_twisting_backward(s, z, *gains, dt), rel=1e-9)


@pytest.mark.parametrize("gains", [OURS, STRONG])
def test_the_rate_of_t_m_is_eq_6_differentiated(gains: tuple[float, float, float, float]) -> None:
    p1, p2, eps, smooth = gains
    h = 1e-6
    for s, s_rate in ((0.3, -1.2), (-0.05, 0.4), (0.9, 2.0), (0.0, 1.0)):
        grown = p2 * sig(s, 1.0 + 2.0 * eps, smooth)
        ahead, behind = (p1 * sig(s + k * h * s_rate, 1.0 + eps, smooth) + k * h * grown for k in (1, -1))
        assert super_twisting_rate(s, s_rate, *gains) == pytest.approx((ahead - behind) / (2.0 * h), rel=1e-6)


def test_the_baseline_switches_with_the_sign_of_s() -> None:
    assert [switching(s, 5.0) for s in (-1e-9, 0.0, 0.3)] == [-5.0, 0.0, 5.0]


def test_the_feedback_in_eq_7_is_minus_c_e_rate_minus_t_m() -> None:
    assert equivalent_and_reaching(4.0, 0.3, -1.1) == pytest.approx(-4.0 * 0.3 + 1.1)


def test_a_sliding_error_dies_out_at_the_rate_c() -> None:
    """On s = 0, Eq. (5) is e' = -c e."""
    c, e, dt = 4.0, 0.1, 1e-4
    for _ in range(2500):
        e += dt * (sliding_variable(c, e, 0.0) * -1.0)
    assert e == pytest.approx(0.1 * exp(-1.0), rel=1e-3)

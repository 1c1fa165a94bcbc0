"""Signed powers, FTESO (Eqs. 3-4) and super-twisting (Eqs. 5-6), as printed and as a backward Euler step of it.

Imports nothing of the product. Fine explicit integration stands for the differential equation; a backward Euler step
is solved by bisection, which knows nothing but that its left side rises.
"""

from collections.abc import Callable

import numpy as np


def sig(x: float, power: float, smooth: float = 0.0) -> float:
    """sig(x)^power = |x|^power sign(x), in the rounded form x (x^2 + d^2)^((power - 1) / 2)."""
    if x == 0.0:
        return 0.0
    return float(x * np.sqrt(x * x + smooth * smooth) ** (power - 1.0))


def bisected(rising: Callable[[float], float], y: float) -> float:
    """x of rising(x) = y for a rising odd function with |rising(x)| >= |x|."""
    low, high = (0.0, y) if y > 0.0 else (y, 0.0)
    for _ in range(400):
        middle = 0.5 * (low + high)
        if middle in (low, high):
            break
        low, high = (middle, high) if rising(middle) < y else (low, middle)
    return 0.5 * (low + high)


def fteso_rate(z: np.ndarray, y: float, u: float, w: float, a: float, e0: float, smooth: float) -> np.ndarray:
    """Eqs. (3)-(4): Z' for the measurement y and the model g u + f, b1 = 3 w, b2 = 3 w^2, b3 = w^3."""
    e = (y - z[0]) / e0
    b = np.array([3.0 * w, 3.0 * w**2, w**3])
    corrections = b * e0 * np.array([sig(e, 1.0 + k * a, smooth) for k in (1, 2, 3)])
    return np.array([z[1], z[2] + u, 0.0]) + corrections


def fteso_backward(
    z: np.ndarray, y: float, u: float, dt: float, w: float, a: float, e0: float, smooth: float
) -> np.ndarray:
    """One step: the model exactly, the corrections at the error that they leave."""
    free = np.array([z[0] + dt * z[1] + 0.5 * dt**2 * (z[2] + u), z[1] + dt * (z[2] + u), z[2]])

    def corrected(e: float) -> np.ndarray:
        third = dt * w**3 * sig(e, 1.0 + 3.0 * a, smooth)
        second = dt * (3.0 * w**2 * sig(e, 1.0 + 2.0 * a, smooth) + third)
        first = dt * (3.0 * w * sig(e, 1.0 + a, smooth) + second)
        return e0 * np.array([first, second, third])

    e = bisected(lambda x: x + corrected(x)[0] / e0, (y - free[0]) / e0)
    return free + corrected(e)


def super_twisting_backward(
    s: float, z_m: float, p1: float, p2: float, eps: float, smooth: float, dt: float
) -> tuple[float, float]:
    """Eq. (6), t_m and z_m, evaluated at the s that s' = -t_m leaves after dt."""

    def t_m(x: float) -> tuple[float, float]:
        grown = z_m + dt * p2 * sig(x, 1.0 + 2.0 * eps, smooth)
        return p1 * sig(x, 1.0 + eps, smooth) + grown, grown

    return t_m(bisected(lambda x: x + dt * (t_m(x)[0] - z_m), s - dt * z_m))

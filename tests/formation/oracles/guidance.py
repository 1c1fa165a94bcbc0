"""Where vehicles are led that set out from rest: a gap that closes along a minimum-jerk quintic, to a resting target.

Also the circle with a turn. Polynomials are integrated by NumPy. Imports nothing of the product.
"""

import numpy as np
from numpy.polynomial import Polynomial

STEP = Polynomial([0.0, 0.0, 0.0, 10.0, -15.0, 6.0])
"""The minimum-jerk step of Flash and Hogan (1985)."""


def of_polynomial(p: Polynomial, u: float, per_s: float) -> np.ndarray:
    """Value and two time derivatives at u, which passes at per_s."""
    return np.array([p(u), p.deriv()(u) * per_s, p.deriv(2)(u) * per_s**2])


def closing_s(gap: np.ndarray, speed: float) -> float:
    """Peak speed 1.875 d / T, peak acceleration 5.7735 d / T^2 under 2.5 m/s^2, turn under 1 rad/s, 0.6 s at least."""
    d = float(np.linalg.norm(gap[:3]))
    return max(1.875 * d / speed, np.sqrt(5.7735 * d / 2.5), 1.875 * abs(gap[3]), 0.6)


def closing(gap: np.ndarray, t_s: float, duration_s: float) -> np.ndarray:
    """The motion (3, 4) that is left of a gap (4) after t_s."""
    if t_s >= duration_s:
        return np.zeros((3, 4))
    return np.outer(of_polynomial(1.0 - STEP, max(t_s, 0.0) / duration_s, 1.0 / duration_s), gap)


def ramped(t_s: float, rate: float, ramp_s: float, duration_s: float) -> np.ndarray:
    """Angle, rate, acceleration of a turn whose rate rises and falls along the minimum-jerk step."""
    t = float(np.clip(t_s, 0.0, duration_s))
    area = STEP.integ()

    def turned(t: float) -> np.ndarray:
        if t >= ramp_s:
            return np.array([rate * (t - 0.5 * ramp_s), rate, 0.0])
        u = t / ramp_s
        return rate * np.array([ramp_s * area(u), STEP(u), STEP.deriv()(u) / ramp_s])

    if t <= duration_s - ramp_s:
        return turned(t)
    back, total = turned(duration_s - t), rate * (duration_s - ramp_s)
    return np.array([total - back[0], back[1], -back[2]])


def circle(t_s: float, radius: float, lap: np.ndarray, height: float, heading: float, turn: np.ndarray) -> np.ndarray:
    """A point on a circle about the lab's origin at angle lap[0], facing heading + turn[0]; motion (3, 4)."""
    out = np.zeros((3, 4))
    e_r = np.array([np.cos(lap[0]), np.sin(lap[0]), 0.0])
    e_t = np.array([-e_r[1], e_r[0], 0.0])
    out[0, :3] = radius * e_r + [0.0, 0.0, height]
    out[1, :3] = radius * lap[1] * e_t
    out[2, :3] = radius * (lap[2] * e_t - lap[1] ** 2 * e_r)
    out[:, 3] = turn
    out[0, 3] += heading
    return out

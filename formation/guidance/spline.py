"""Ways through points without stopping, from rest to rest: splines, fitted here and evaluated piece by piece.

A spline is (k, 33), a row a piece: the time at which it begins and, of x, y, z and heading, the eight coefficients of
its polynomial in the time since then, highest power first.
"""

from itertools import pairwise
from math import factorial

import numpy as np

from formation.maths.arrays import Float

POWERS = 8
END_LEGS = 1.5
"""A leg from or to rest takes so many times as long as one of its length between others."""
SAMPLES = 50
LEAST_M = 1e-6


def through(points: Float, yaw_rad: float, speed_m_s: float) -> tuple[Float, float]:
    """The spline of least snap through points (k, 3), heading yaw_rad, speed_m_s at its fastest; how long it takes.

    Seventh order, continuous up to the sixth derivative, no acceleration or jerk at its ends (Mellinger and Kumar 2011,
    "Minimum snap trajectory generation and control for quadrotors"; legs take times in proportion to their lengths).
    """
    legs = np.linalg.norm(np.diff(points, axis=0), axis=1)
    distinct = np.concatenate([[True], legs > LEAST_M])
    points, legs = points[distinct], legs[legs > LEAST_M]
    if not len(legs):
        return _pieces(np.array([0.0, 1.0]), np.column_stack([points[[0, 0]], [yaw_rad, yaw_rad]]), 5)
    legs[0] *= END_LEGS
    legs[-1] *= END_LEGS
    t_s = np.concatenate([[0.0], np.cumsum(legs / speed_m_s)])
    rows = np.column_stack([points, np.full(len(points), yaw_rad)])
    fastest_m_s = _fastest(*_pieces(t_s, rows, 7))
    return _pieces(t_s * fastest_m_s / speed_m_s, rows, 7)


def timed(points: Float) -> tuple[Float, float]:
    """The spline through points (k, 5) of time, x, y, z, heading, at rest at its ends; how long it takes.

    Fifth order, continuous up to the fourth derivative: what was recorded has noise, and higher orders have more of it.
    """
    rows = points[:, 1:].copy()
    rows[:, 3] = np.unwrap(rows[:, 3])
    return _pieces(points[:, 0], rows, 5)


def _pieces(t_s: Float, rows: Float, order: int) -> tuple[Float, float]:
    """The spline of that order through rows (k, 4) at t_s, all derivatives up to (order - 1) / 2 zero at its ends."""
    from scipy.interpolate import make_interp_spline

    rest = [(derivative, np.zeros(4)) for derivative in range(1, (order - 1) // 2 + 1)]
    fitted = make_interp_spline(t_s, rows, k=order, bc_type=(rest, rest))  # type: ignore[arg-type]
    pieces = np.zeros((len(t_s) - 1, 1 + 4 * POWERS))
    pieces[:, 0] = t_s[:-1]
    for power in range(order + 1):
        pieces[:, POWERS - power :: POWERS] = fitted.derivative(power)(t_s[:-1]) / factorial(power)
    return pieces, float(t_s[-1])


def _fastest(pieces: Float, duration_s: float) -> float:
    """The highest speed on the way."""
    worst = 0.0
    out = np.zeros((3, 4))
    ends = np.append(pieces[:, 0], duration_s)
    for begin, end in pairwise(ends.tolist()):
        for t_s in np.linspace(begin, end, SAMPLES):
            at(pieces, float(t_s), out)
            worst = max(worst, float(np.linalg.norm(out[1, :3])))
    return worst


def at(pieces: Float, t_s: float, out: Float) -> None:
    """Position, velocity, acceleration (rows) of x, y, z, heading (columns) at t_s into out (3, 4)."""
    low, high = 0, len(pieces) - 1
    while low < high:
        middle = (low + high + 1) // 2
        if pieces[middle, 0] <= t_s:
            low = middle
        else:
            high = middle - 1
    since_s = t_s - pieces[low, 0]
    for axis in range(4):
        value = rate = acc = 0.0
        for power in range(POWERS):
            acc = acc * since_s + 2.0 * rate
            rate = rate * since_s + value
            value = value * since_s + pieces[low, 1 + POWERS * axis + power]
        out[0, axis], out[1, axis], out[2, axis] = value, rate, acc

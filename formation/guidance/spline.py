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
    """The spline of that odd order through rows (k, 4) at t_s, all derivatives up to (order - 1) / 2 zero at its ends.

    Of all curves through the rows it has the least integral of the squared derivative (order + 1) / 2 (de Boor 2001, "A
    Practical Guide to Splines", chapter V). In the derivatives at the inner rows that is a block-tridiagonal system.
    """
    known, durations_s = (order + 1) // 2, np.diff(t_s)
    coefficients, energy = _unit_piece(known)
    scale = durations_s[:, None] ** np.tile(np.arange(known), 2)
    blocks = scale[:, :, None] * energy * scale[:, None, :] / durations_s[:, None, None] ** order
    left, right, values = slice(1, known), slice(known + 1, None), [0, known]
    pairs = np.stack([rows[:-1], rows[1:]], 1)
    diagonal = blocks[:-1, right, right] + blocks[1:, left, left]
    forces = -(blocks[:-1, right][:, :, values] @ pairs[:-1] + blocks[1:, left][:, :, values] @ pairs[1:])
    ends = np.zeros((len(rows), known, 4))
    ends[:, 0] = rows
    ends[1:-1, 1:] = _solve_block_tridiagonal(diagonal, blocks[1:-1, left, right], forces)
    unit = coefficients @ (scale[:, :, None] * np.concatenate([ends[:-1], ends[1:]], 1))
    pieces = np.zeros((len(durations_s), 1 + 4 * POWERS))
    pieces[:, 0] = t_s[:-1]
    for power in range(order + 1):
        pieces[:, POWERS - power :: POWERS] = unit[:, power] / durations_s[:, None] ** power
    return pieces, float(t_s[-1])


def _unit_piece(known: int) -> tuple[Float, Float]:
    """Of a polynomial over a time of 1 with `known` derivatives, from the zeroth, at either end: the matrix that makes
    its coefficients (lowest power first) of them, and that of the integral of its squared derivative `known`."""
    powers = np.arange(2 * known)
    ends = np.zeros((2 * known, 2 * known))
    falling = np.ones(2 * known)  # what a derivative makes of each power at time 1
    for derivative in range(known):
        ends[derivative, derivative] = factorial(derivative)
        ends[known + derivative] = falling
        falling = falling * np.maximum(powers - derivative, 0)
    coefficients = np.linalg.inv(ends).astype(np.float64, copy=False)
    left = np.maximum(powers - known, 0)
    squared = np.outer(falling, falling) / (left[:, None] + left + 1)
    return coefficients, coefficients.T @ squared @ coefficients


def _solve_block_tridiagonal(diagonal: Float, upper: Float, right_side: Float) -> Float:
    """x (k, m, n) of a symmetric positive definite system: diagonal (k, m, m), upper (k - 1, m, m), right_side."""
    solved, factors = np.empty_like(right_side), list[Float]()
    for i, block in enumerate(diagonal):
        carried = upper[i - 1].T if i else None
        if carried is not None:
            block = block - carried @ factors[-1]
        solved[i] = np.linalg.solve(
            block, right_side[i] if carried is None else right_side[i] - carried @ solved[i - 1]
        )
        if i < len(upper):
            factors.append(np.linalg.solve(block, upper[i]))
    for i in range(len(diagonal) - 2, -1, -1):
        solved[i] -= factors[i] @ solved[i + 1]
    return solved


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

"""Poses as camera systems send them, row by row, into ours; one compiled call a frame."""

import numpy as np
from numpy.typing import NDArray

from formation.maths.arrays import Bool, Float
from formation.maths.kernel import kernel

Rows = NDArray[np.floating]


def from_quaternions(rows: Rows, unit_m: float) -> tuple[Float, Float]:
    """Positions in m (n, 3) and quaternions w x y z (n, 4) of rows (n, 7): x y z, quaternion x y z w; any numbers."""
    pos_m, q = np.empty((len(rows), 3)), np.empty((len(rows), 4))
    _from_quaternions(_aligned(rows), unit_m, pos_m, q)
    return pos_m, q


def from_matrices(rows: Rows, by_columns: bool, unit_m: float, lost_is_nan: bool) -> tuple[Float, Float, Bool]:
    """Positions in m (n, 3), unit w x y z (n, 4), w >= 0, and seen (n,) of rows (n, 12): x y z, rotation matrix.

    by_columns: how the matrix is written. lost_is_nan: whether a lost body has a NaN in its position, or zeros; it is
    put at zero. Of a matrix that is no rotation the quaternion is zeros.
    """
    n = len(rows)
    pos_m, q, seen = np.empty((n, 3)), np.empty((n, 4)), np.empty(n, np.bool_)
    _from_matrices(_aligned(rows), by_columns, unit_m, lost_is_nan, pos_m, q, seen)
    return pos_m, q, seen


def _aligned(rows: Rows) -> Rows:
    """A copy: in a packet they may begin anywhere, and kernels are compiled for arrays that do not."""
    copy: Rows = np.array(rows, order="C")
    return copy


@kernel
def _from_quaternions(rows: Rows, unit_m: float, pos_m: Float, q: Float) -> None:
    for i in range(len(rows)):
        for k in range(3):
            pos_m[i, k] = rows[i, k] * unit_m
            q[i, 1 + k] = rows[i, 3 + k]
        q[i, 0] = rows[i, 6]


@kernel
def _from_matrices(
    rows: Rows, by_columns: bool, unit_m: float, lost_is_nan: bool, pos_m: Float, q: Float, seen: Bool
) -> None:  # fmt: skip
    """A rotation's entries add up to those of 4 q q^T, each row of which is q up to a factor.

    The one with the longest diagonal is taken (Bar-Itzhack, New method for extracting the quaternion from a rotation
    matrix, 2000). Those of a mirror, of anything scaled or skewed by more than 1 %, and of NaN add up otherwise.
    """
    r, squares = np.empty((3, 3)), np.empty((4, 4))
    for i in range(len(rows)):
        x, y, z = rows[i, 0], rows[i, 1], rows[i, 2]
        if lost_is_nan:
            seen[i] = not (np.isnan(x) or np.isnan(y) or np.isnan(z))
        else:
            seen[i] = x != 0.0 or y != 0.0 or z != 0.0
        for k in range(3):
            pos_m[i, k] = rows[i, k] * unit_m if seen[i] else 0.0
        for k in range(9):
            if by_columns:
                r[k % 3, k // 3] = rows[i, 3 + k]
            else:
                r[k // 3, k % 3] = rows[i, 3 + k]
        squares[0, 0] = 1.0 + r[0, 0] + r[1, 1] + r[2, 2]
        squares[1, 1] = 1.0 + r[0, 0] - r[1, 1] - r[2, 2]
        squares[2, 2] = 1.0 + r[1, 1] - r[0, 0] - r[2, 2]
        squares[3, 3] = 1.0 + r[2, 2] - r[0, 0] - r[1, 1]
        squares[0, 1] = squares[1, 0] = r[2, 1] - r[1, 2]
        squares[0, 2] = squares[2, 0] = r[0, 2] - r[2, 0]
        squares[0, 3] = squares[3, 0] = r[1, 0] - r[0, 1]
        squares[1, 2] = squares[2, 1] = r[0, 1] + r[1, 0]
        squares[1, 3] = squares[3, 1] = r[0, 2] + r[2, 0]
        squares[2, 3] = squares[3, 2] = r[1, 2] + r[2, 1]
        longest = 0
        for k in range(1, 4):
            if squares[k, k] > squares[longest, longest]:
                longest = k
        norm = 0.0
        for k in range(4):
            norm += squares[longest, k] ** 2
        norm = np.copysign(np.sqrt(norm), squares[longest, 0])
        is_rotation = True
        for k in range(4):
            q[i, k] = squares[longest, k] / norm
        for j in range(4):
            for k in range(4):
                is_rotation = is_rotation and abs(squares[j, k] - 4.0 * q[i, j] * q[i, k]) <= 0.04
        if not is_rotation:
            q[i] = 0.0

"""Rotation matrices of camera systems, as quaternions."""

import numpy as np
from numpy.typing import NDArray

from formation.maths.arrays import Float

RIGID_WITHIN = 0.01


def _signs() -> Float:
    """How the entries of a matrix, xx to zz, add up to those of 4 q q^T less its constant part; (9, 16)."""
    xx, xy, xz, yx, yy, yz, zx, zy, zz = np.eye(9)
    rows = [
        [xx + yy + zz, zy - yz, xz - zx, yx - xy],
        [zy - yz, xx - yy - zz, xy + yx, zx + xz],
        [xz - zx, xy + yx, yy - xx - zz, yz + zy],
        [yx - xy, zx + xz, yz + zy, zz - xx - yy],
    ]
    return np.array(rows).reshape(16, 9).T


_SIGNS = _signs()
_CONSTANT = np.eye(4).ravel()


def quaternions(matrices: NDArray[np.floating]) -> Float:
    """Unit w, x, y, z of rotation matrices (n, 3, 3), rows first; all zeros for a matrix that is no rotation.

    A rotation's entries add up to those of 4 q q^T, each row of which is q up to a factor: the one with the longest
    diagonal is taken (Bar-Itzhack, New method for extracting the quaternion from a rotation matrix, 2000). Those of a
    mirror, of anything scaled or skewed by more than 1 %, and of NaN add up to something else.
    """
    n = len(matrices)
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        table = np.asarray(matrices, np.float64).reshape(n, 9) @ _SIGNS + _CONSTANT
        squares = table.reshape(n, 4, 4)
        rows = squares[np.arange(n), table[:, ::5].argmax(axis=1)]
        q: Float = rows / np.copysign(np.sqrt((rows * rows).sum(axis=1)), rows[:, 0])[:, None]
        off = np.abs(squares - 4.0 * q[:, :, None] * q[:, None, :]).reshape(n, 16).max(axis=1)
        q[~(off <= 4.0 * RIGID_WITHIN)] = 0.0
    return q

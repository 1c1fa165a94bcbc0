"""Rotation matrices of camera systems, as quaternions."""

import numpy as np
from numpy.typing import NDArray

from formation.maths.arrays import Float

RIGID_WITHIN = 0.01


def quaternions(matrices: NDArray[np.floating]) -> Float:
    """Unit w, x, y, z of rotation matrices (n, 3, 3), rows first; all zeros for a matrix that is no rotation.

    Each row of 4 q q^T, whose entries are sums of the matrix's, is q up to a factor: the longest is taken (Bar-Itzhack,
    New method for extracting the quaternion from a rotation matrix, 2000, without its eigenvectors).
    """
    m = np.asarray(matrices, np.float64)
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = np.moveaxis(m, 0, -1)
    table = np.array(
        [
            [1 + xx + yy + zz, zy - yz, xz - zx, yx - xy],
            [zy - yz, 1 + xx - yy - zz, xy + yx, zx + xz],
            [xz - zx, xy + yx, 1 - xx + yy - zz, yz + zy],
            [yx - xy, zx + xz, yz + zy, 1 - xx - yy + zz],
        ]
    )
    longest = np.argmax(np.einsum("iin->in", table), axis=0)
    rows = table[longest, :, np.arange(len(m))]
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        q = rows / np.linalg.norm(rows, axis=1, keepdims=True)
    q[~are_rotations(m)] = 0.0
    upper: Float = np.where(q[:, :1] < 0.0, -q, q)
    return upper


def are_rotations(m: Float) -> NDArray[np.bool_]:
    """Which of (n, 3, 3) are rotations, within 1 %; not those with NaN, nor mirrors."""
    with np.errstate(invalid="ignore", over="ignore"):
        off = np.abs(m @ np.swapaxes(m, 1, 2) - np.eye(3)).max(axis=(1, 2), initial=0.0)
        upright = np.einsum("ni,ni->n", np.cross(m[:, 0], m[:, 1]), m[:, 2]) > 0.0
    are: NDArray[np.bool_] = (off <= RIGID_WITHIN) & upright
    return are

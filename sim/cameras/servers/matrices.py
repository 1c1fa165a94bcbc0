"""Rotation matrices of poses, as fast as servers of hundreds of frames a second need them."""

import numpy as np

from formation.maths.arrays import Float


def matrices(q: Float) -> Float:
    """R_a_from_b of unit q_a_from_b, w x y z; (n, 4) to (n, 3, 3)."""
    w, x, y, z = np.ascontiguousarray(q.T)
    xx, yy, zz = 2.0 * x * x, 2.0 * y * y, 2.0 * z * z
    xy, xz, yz = 2.0 * x * y, 2.0 * x * z, 2.0 * y * z
    wx, wy, wz = 2.0 * w * x, 2.0 * w * y, 2.0 * w * z
    rows = (1.0 - yy - zz, xy - wz, xz + wy, xy + wz, 1.0 - xx - zz, yz - wx, xz - wy, yz + wx, 1.0 - xx - yy)
    return np.stack(rows, axis=-1).reshape(-1, 3, 3)

"""Roll, pitch and yaw of many attitudes at once, as MAVLink has them."""

from math import asin, atan2, copysign, pi

import numpy as np

from formation.maths.arrays import Quats, Vec3s
from formation.maths.kernel import kernel
from wire.mavlink.motion import POLE


@kernel
def euler_ned_from_frd(q_lab_from_flu: Quats) -> Vec3s:
    """Roll, pitch, yaw of each (m, 3): `wire.mavlink.motion.euler_ned_from_frd`."""
    euler = np.empty((len(q_lab_from_flu), 3))
    for i in range(len(q_lab_from_flu)):
        q = q_lab_from_flu[i]
        w, x, y, z = q[0], q[1], 0.0 - q[2], 0.0 - q[3]
        sin_pitch = 2.0 * (w * y - z * x)
        if abs(sin_pitch) > POLE:
            side = copysign(1.0, sin_pitch)
            euler[i, 0], euler[i, 1], euler[i, 2] = 0.0, side * 0.5 * pi, _exact(-2.0 * side * atan2(x, w))
            continue
        euler[i, 0] = _exact(atan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y)))
        euler[i, 1] = _exact(asin(sin_pitch))
        euler[i, 2] = _exact(atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)))
    return euler


@kernel
def _exact(angle: float) -> float:
    """Zero for what is only the rounding of zero, as there."""
    return 0.0 if -1e-12 < angle < 1e-12 else angle

"""VISION_POSITION_ESTIMATE for many drones at once: byte for byte what `Codec.encode` makes of each, in a few calls."""

from collections.abc import Sequence
from math import asin, atan2, copysign, pi

import numpy as np

from formation.maths.arrays import Quats, Vec3s
from formation.maths.kernel import kernel
from wire.link_messages.address import Address
from wire.mavlink.frame_batch import FrameBatch
from wire.mavlink.motion import POLE, UNKNOWN_COVARIANCE, VISION_POSITION_ESTIMATE


class PoseBatch:
    """The poses of m drones."""

    def __init__(self, source: Address, count: int) -> None:
        """source: whose frames they are."""
        fields = [
            ("t_us", "<u8"), ("position_m", "<f4", 3), ("euler_rad", "<f4", 3), ("covariance", "<f4", 21),
            ("resets", "u1"),
        ]  # fmt: skip
        self._batch = FrameBatch(VISION_POSITION_ESTIMATE, fields, source, count)
        self._batch.blank["covariance"] = UNKNOWN_COVARIANCE

    def encode(self, t_us: int, pos_lab_m: Vec3s, q_lab_from_flu: Quats, seqs: Sequence[int]) -> list[bytes]:
        """One frame each (m), with its sequence number, of a capture at t_us."""
        memory, frames = self._batch.begin()
        frames["t_us"], frames["seq"] = t_us, seqs
        position, euler = frames["position_m"], frames["euler_rad"]
        position[:, 0], position[:, 1:] = pos_lab_m[:, 0], 0.0 - pos_lab_m[:, 1:]
        euler[:] = _euler_ned_from_frd(q_lab_from_flu)
        return self._batch.finish(memory)


@kernel
def _euler_ned_from_frd(q_lab_from_flu: Quats) -> Vec3s:
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

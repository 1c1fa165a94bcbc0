"""VISION_POSITION_ESTIMATE for many drones at once: byte for byte what `Codec.encode` makes of each, in a few calls."""

from collections.abc import Sequence

from formation.maths.arrays import Quats, Vec3s
from wire.link_messages import Address
from wire.mavlink.euler import euler_ned_from_frd
from wire.mavlink.frame_batch import FrameBatch
from wire.mavlink.motion import UNKNOWN_COVARIANCE, VISION_POSITION_ESTIMATE


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
        euler[:] = euler_ned_from_frd(q_lab_from_flu)
        return self._batch.finish(memory)

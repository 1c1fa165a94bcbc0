"""SET_ATTITUDE_TARGET for many drones at once: byte for byte what `Codec.encode` makes of each, in a few calls."""

from collections.abc import Sequence

from formation.messages import AttitudeTarget
from wire.link_messages import Address
from wire.mavlink.frame_batch import FrameBatch
from wire.mavlink.motion import SET_ATTITUDE_TARGET


class SetpointBatch:
    """The setpoints of m drones."""

    def __init__(self, source: Address, targets: Sequence[Address]) -> None:
        """source: whose frames they are; targets: the drones (m)."""
        fields = [
            ("t_boot_ms", "<u4"), ("q", "<f4", 4), ("rate_rad_s", "<f4", 3), ("thrust_norm", "<f4"),
            ("target", "u1", 2), ("ignore", "u1"),
        ]  # fmt: skip
        self._batch = FrameBatch(SET_ATTITUDE_TARGET, fields, source, len(targets))
        self._batch.blank["target"] = targets

    def encode(self, target: AttitudeTarget, t_ms: int, ignore: Sequence[int], seqs: Sequence[int]) -> list[bytes]:
        """One frame each (m), with its type mask and its sequence number; all numbers of the target must be finite.

        t_ms: time stamp of all, of which MAVLink carries the lowest 32 bits.
        """
        memory, frames = self._batch.begin()
        q, rate = target.q_lab_from_flu, target.rate_flu_rad_s
        frames["seq"], frames["ignore"] = seqs, ignore
        frames["t_boot_ms"], frames["thrust_norm"] = t_ms & 0xFFFFFFFF, target.thrust_norm
        frames["q"][:, :2], frames["q"][:, 2:] = q[:, :2], 0.0 - q[:, 2:]
        frames["rate_rad_s"][:, :1], frames["rate_rad_s"][:, 1:] = rate[:, :1], 0.0 - rate[:, 1:]
        return self._batch.finish(memory)

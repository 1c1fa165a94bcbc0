"""One message for many drones at once: byte for byte what `Codec.encode` makes of each, in a few calls.

What all frames have in common is filled in once; numbers, checksums and cut zeros are filled in by compiled loops.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from formation.maths.arrays import Quats, Vec3s
from formation.maths.kernel import kernel
from formation.messages import AttitudeTarget
from wire.link_messages import Address
from wire.mavlink.axes import euler, exact
from wire.mavlink.framing import Layout, layout
from wire.mavlink.messages import SET_ATTITUDE_TARGET, UNKNOWN_COVARIANCE

Bytes = NDArray[np.uint8]
Index = NDArray[np.int64]
Frames = NDArray[Any]

_HEAD, _CHECKSUM = 10, 2
_VISION_POSITION_ESTIMATE = layout("VISION_POSITION_ESTIMATE", 29)


class FrameBatch:
    """Frames (m) of one message, as MAVLink 2 has them, unsigned."""

    def __init__(self, layout: Layout, fields: list[tuple[Any, ...]], source: Address, count: int) -> None:
        """fields: numpy's description of the payload's, in the order of the wire. source: whose frames they are."""
        head = [("magic", "u1"), ("size", "u1"), ("flags", "<u2"), ("seq", "u1"), ("source", "u1", 2)]
        self._dtype = np.dtype([*head, ("number", "u1", 3), *fields, ("checksum", "u1", _CHECKSUM)])
        self._crc_extra, self._count = layout.crc_extra, count
        self.blank: Frames = np.zeros(count, self._dtype)
        """The beginning of every batch."""
        self.blank["magic"] = 0xFD
        self.blank["source"], self.blank["number"] = source, tuple(layout.id.to_bytes(3, "little"))

    def begin(self) -> tuple[bytearray, Frames]:
        """Memory for a batch, and its frames in it, to be filled in."""
        # As bytes: numpy copies a structured array field by field.
        memory = bytearray(self.blank.view(np.uint8).data)
        return memory, np.ndarray(self._count, self._dtype, memory)

    def finish(self, memory: bytearray) -> list[bytes]:
        """The bytes of each frame, as pymavlink makes them of the same fields."""
        size = self._dtype.itemsize
        ends = _seal(np.ndarray((self._count, size), np.uint8, memory), self._crc_extra)
        return [bytes(memory[k * size : k * size + end]) for k, end in enumerate(ends.tolist())]


@kernel
def _seal(frames: Bytes, crc_extra: int) -> Index:
    """Cuts the zeros at each payload's end and puts its checksum behind it; the lengths of the frames (m)."""
    ends = np.empty(len(frames), np.int64)
    for i in range(len(frames)):
        frame = frames[i]
        end = len(frame) - _CHECKSUM
        while end > _HEAD + 1 and frame[end - 1] == 0:
            end -= 1
        frame[1] = end - _HEAD
        crc = 0xFFFF
        for k in range(1, end):
            crc = _accumulated(crc, int(frame[k]))
        crc = _accumulated(crc, crc_extra)
        frame[end], frame[end + 1] = crc & 0xFF, crc >> 8
        ends[i] = end + _CHECKSUM
    return ends


@kernel
def _accumulated(crc: int, byte: int) -> int:
    """CRC-16/MCRF4XX with one more byte (MAVLink's crc_accumulate)."""
    low = (byte ^ crc) & 0xFF
    low = (low ^ (low << 4)) & 0xFF
    return (crc >> 8) ^ (low << 8) ^ (low << 3) ^ (low >> 4)


def _eulers(q_lab_from_flu: Quats) -> Vec3s:
    """Roll, pitch, yaw of each (m, 3): `wire.mavlink.axes.euler_ned_from_frd`."""
    angles = np.empty((len(q_lab_from_flu), 3))
    for i in range(len(q_lab_from_flu)):
        q = q_lab_from_flu[i]
        angles[i, 0], angles[i, 1], angles[i, 2] = euler(q[0], q[1], 0.0 - q[2], 0.0 - q[3])
    return angles


_compiled_eulers = kernel(_eulers, (exact, euler))


class PoseBatch:
    """The poses of m drones."""

    def __init__(self, source: Address, count: int) -> None:
        """source: whose frames they are."""
        fields = [
            ("t_us", "<u8"), ("position_m", "<f4", 3), ("euler_rad", "<f4", 3), ("covariance", "<f4", 21),
            ("resets", "u1"),
        ]  # fmt: skip
        self._batch = FrameBatch(_VISION_POSITION_ESTIMATE, fields, source, count)
        self._batch.blank["covariance"] = UNKNOWN_COVARIANCE

    def encode(self, t_us: int, pos_lab_m: Vec3s, q_lab_from_flu: Quats, seqs: Sequence[int]) -> list[bytes]:
        """One frame each (m), with its sequence number, of a capture at t_us."""
        memory, frames = self._batch.begin()
        frames["t_us"], frames["seq"] = t_us, seqs
        position, euler = frames["position_m"], frames["euler_rad"]
        position[:, 0], position[:, 1:] = pos_lab_m[:, 0], 0.0 - pos_lab_m[:, 1:]
        euler[:] = _compiled_eulers(q_lab_from_flu)
        return self._batch.finish(memory)


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

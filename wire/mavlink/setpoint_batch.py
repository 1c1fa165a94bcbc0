"""SET_ATTITUDE_TARGET for many drones at once: byte for byte what `Codec.encode` makes of each, in a few calls."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from formation.maths.kernel import kernel
from formation.messages import AttitudeTarget
from wire.link_messages.address import Address
from wire.mavlink.motion import SET_ATTITUDE_TARGET

Bytes = NDArray[np.uint8]
Index = NDArray[np.int64]

_HEAD, _CHECKSUM = 10, 2
_FRAME = np.dtype(
    [
        ("magic", "u1"), ("size", "u1"), ("flags", "<u2"), ("seq", "u1"), ("source", "u1", 2), ("number", "u1", 3),
        ("t_boot_ms", "<u4"), ("q", "<f4", 4), ("rate_rad_s", "<f4", 3), ("thrust_norm", "<f4"), ("target", "u1", 2),
        ("ignore", "u1"), ("checksum", "u1", _CHECKSUM),
    ]
)  # fmt: skip
"""A whole frame of MAVLink 2, its fields in the order of the wire."""


class SetpointBatch:
    """The setpoints of m drones: what all frames of a drone have in common is filled in once."""

    def __init__(self, source: Address, targets: Sequence[Address]) -> None:
        """source: whose frames they are; targets: the drones (m)."""
        self._blank = np.zeros(len(targets), _FRAME)
        self._blank["magic"] = 0xFD
        self._blank["source"], self._blank["number"] = source, (SET_ATTITUDE_TARGET.id, 0, 0)
        self._blank["target"] = targets

    def encode(self, target: AttitudeTarget, t_ms: int, ignore: Sequence[int], seqs: Sequence[int]) -> list[bytes]:
        """One frame each (m), with its type mask and its sequence number; all numbers of the target must be finite.

        t_ms: time stamp of all, of which MAVLink carries the lowest 32 bits.
        """
        frames, q, rate = self._blank.copy(), target.q_lab_from_flu, target.rate_flu_rad_s
        frames["seq"], frames["ignore"] = seqs, ignore
        frames["t_boot_ms"], frames["thrust_norm"] = t_ms & 0xFFFFFFFF, target.thrust_norm
        frames["q"][:, :2], frames["q"][:, 2:] = q[:, :2], 0.0 - q[:, 2:]
        frames["rate_rad_s"][:, :1], frames["rate_rad_s"][:, 1:] = rate[:, :1], 0.0 - rate[:, 1:]
        size = _FRAME.itemsize
        raw = frames.view(np.uint8).reshape(len(frames), size)
        ends = _seal(raw, SET_ATTITUDE_TARGET.crc_extra)
        data = raw.tobytes()
        return [data[k * size : k * size + end] for k, end in enumerate(ends.tolist())]


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

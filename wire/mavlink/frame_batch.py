"""Frames of one message for many drones at once: what all have in common is filled in once, the rest in a few calls."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from formation.maths.kernel import kernel
from wire.link_messages import Address
from wire.mavlink.framing import Layout

Bytes = NDArray[np.uint8]
Index = NDArray[np.int64]
Frames = NDArray[Any]

_HEAD, _CHECKSUM = 10, 2


class FrameBatch:
    """Frames (m) of one message, as MAVLink 2 has them, unsigned."""

    def __init__(self, layout: Layout, fields: list[tuple[Any, ...]], source: Address, count: int) -> None:
        """fields: numpy's description of the payload's, in the order of the wire. source: whose frames they are."""
        head = [("magic", "u1"), ("size", "u1"), ("flags", "<u2"), ("seq", "u1"), ("source", "u1", 2)]
        self._dtype = np.dtype([*head, ("number", "u1", 3), *fields, ("checksum", "u1", _CHECKSUM)])
        self._crc_extra, self._count = layout.crc_extra, count
        self.blank: Frames = np.zeros(count, self._dtype)
        """What every batch begins with."""
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

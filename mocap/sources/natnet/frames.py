"""A frame of mocap data: its rigid bodies and when it was exposed; whatever else is in it is passed over.

Up to 4.0 a section can only be passed over by what is counted in it; from 4.1 each says its length in bytes.
"""

from dataclasses import dataclass
from struct import Struct
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mocap.sources.natnet.messages import BYTE_COUNTS, Version
from mocap.sources.natnet.reader import Reader

BODY = np.dtype([("id", "<i4"), ("pose", "<f4", 7), ("error", "<f4"), ("params", "<i2")])
"""pose: x y z, quaternion x y z w."""
TRACKED = 0x01
"""Of a body's params: seen in this frame."""
MODELS_CHANGED, EDITED, VERSION_CHANGED = 0x02, 0x04, 0x08
"""Of a frame's params; EDITED: what was recorded is played, not what the cameras see."""
MARKER_BYTES, POINT_BYTES, VALUE_BYTES = 26, 12, 4

_NUMBER = Struct("<i")
_SUFFIX = Struct("<2Id3QhI")
"""Timecode and its sub-frame, time stamp, mid-exposure, data received, transmit, params, end of data."""
_SUFFIX_PRECISE = Struct("<2Id3Q2IhI")
"""As well the precision time (PTP), seconds and fraction, before params."""
_MID_EXPOSURE = 3
SECTIONS = ("marker sets", "other markers", "rigid bodies", "skeletons", "assets", "markers", "force plates", "devices")


@dataclass(frozen=True, slots=True, eq=False)
class Frame:
    """bodies: an array of BODY, metres. exposure_ticks: the middle of the exposure, 0 if cameras report none."""

    number: int
    bodies: NDArray[Any]
    exposure_ticks: int
    params: int


def frame_of_data(payload: bytes, version: Version) -> Frame:
    """PacketError where the payload is not exactly a frame of that version."""
    reader = Reader(payload, "frame of data")
    number = reader.integer(_NUMBER, "number")
    counted = version >= BYTE_COUNTS
    count, at = _sections_by_bytes(reader) if counted else _sections_by_counts(reader)
    suffix = reader.fields(_SUFFIX_PRECISE if counted else _SUFFIX, "suffix")
    reader.whole()
    bodies = np.frombuffer(payload, BODY, count, at) if count else np.empty(0, BODY)
    return Frame(number, bodies, int(suffix[_MID_EXPOSURE]), int(suffix[-2]))


def _sections_by_bytes(reader: Reader) -> tuple[int, int]:
    """The count of rigid bodies, and where they begin."""
    bodies = 0, 0
    for what in SECTIONS:
        count, size, at = reader.section(what)
        if what == "rigid bodies":
            if size != count * BODY.itemsize:
                raise reader.error(what, "count and byte count differ")
            bodies = count, at
    return bodies


def _sections_by_counts(reader: Reader) -> tuple[int, int]:
    for _ in range(reader.count(5, "marker sets")):
        reader.text("marker set name")
        reader.rows(POINT_BYTES, "marker set")
    reader.rows(POINT_BYTES, "other markers")
    bodies = reader.rows(BODY.itemsize, "rigid bodies")
    for _ in range(reader.count(8, "skeletons")):
        reader.skip(4, "skeletons")
        reader.rows(BODY.itemsize, "bones")
    reader.rows(MARKER_BYTES, "markers")
    for what in ("force plates", "devices"):
        for _ in range(reader.count(8, what)):
            reader.skip(4, what)
            for _ in range(reader.count(4, what)):
                reader.rows(VALUE_BYTES, what)
    return bodies

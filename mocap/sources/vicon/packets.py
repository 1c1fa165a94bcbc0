"""Vicon's packets of objects as they lie in the stream, and how one is laid out. Pure.

A packet is a tag, a length and blocks; a block is a kind, a length and one object. All little endian. Source: the
stream classes that Vicon publishes with its DataStream SDK (Enum.h, SubjectInfo.h, GlobalSegments.h and others).

From frame to frame only numbers change: the frame's own, the latencies, the segments' places. Whatever else is in a
packet (kinds, lengths, counts, identifiers) is compared byte by byte with one that was read, and found right, before:
a packet of the same layout is not taken apart again.
"""

import math
import struct
from collections.abc import Collection, Iterable, Mapping, Sequence
from enum import IntEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mocap.sources.tcp import LARGEST_PACKET, ProtocolError
from wire.transport.frame_check import MOST_BODIES

HEADER = struct.Struct("<II")
STREAM_TAG = 0x1A2B0001
MOST_BLOCKS = 4 * MOST_BODIES
TICKS_HZ = 135_000_000
SEGMENT = struct.Struct("<I12d")
"""Identifier; translation, mm; rotation, rows first."""
_U32, _I64 = struct.Struct("<I"), struct.Struct("<q")
_PARENTAGE = struct.Struct("<II6f")

Block = tuple[int, bytes]


class Kind(IntEnum):
    """What a block holds."""

    STREAM_INFO = 1
    SUBJECT_INFO = 2
    FRAME_INFO = 5
    GLOBAL_SEGMENTS = 9
    LATENCY_INFO = 26
    APPLICATION_INFO = 37
    FRAME_RATE_INFO = 39
    PING = 42
    OBJECT_ENUMS = 100001
    REQUEST_FRAME = 100002
    CONTENTS = 100004


class Stream:
    """Cuts the bytes that come into packets."""

    def __init__(self) -> None:
        self._data = bytearray()

    def receive(self, data: bytes) -> list[bytes]:
        """The packets that are complete now, without their headers; ProtocolError where the stream is none."""
        self._data += data
        packets, start = [], 0
        while len(self._data) - start >= HEADER.size:
            tag, size = HEADER.unpack_from(self._data, start)
            if tag != STREAM_TAG:
                raise ProtocolError("packet header: not that of a packet of objects")
            if size > LARGEST_PACKET:
                raise ProtocolError("packet header: a length that no packet has")
            end = start + HEADER.size + size
            if len(self._data) < end:
                break
            packets.append(bytes(self._data[start + HEADER.size : end]))
            start = end
        del self._data[:start]
        return packets


def packet_of(*blocks: Block) -> bytes:
    """A packet of these blocks."""
    body = b"".join(HEADER.pack(kind, len(data)) + data for kind, data in blocks)
    return HEADER.pack(STREAM_TAG, len(body)) + body


def blocks_of(packet: bytes) -> list[Block]:
    """A packet's blocks; ValueError where their lengths are not the packet's."""
    blocks: list[Block] = []
    at, whole = 0, len(packet)
    while at < whole:
        if whole - at < HEADER.size:
            raise ValueError("block header: cut short")
        kind, size = HEADER.unpack_from(packet, at)
        at += HEADER.size + size
        if at > whole:
            raise ValueError("block header: a length beyond the packet")
        blocks.append((kind, packet[at - size : at]))
        if len(blocks) > MOST_BLOCKS:
            raise ValueError("packet: more blocks than any packet has")
    return blocks


def set_of(kinds: Iterable[int]) -> bytes:
    """Kinds as a set is written: their number, then each in order."""
    ordered = sorted(kinds)
    return struct.pack(f"<I{len(ordered)}I", len(ordered), *ordered)


def kinds_of(data: bytes) -> frozenset[int]:
    """The kinds that ObjectEnums lists."""
    n = _u32(data, 0, "ObjectEnums")
    if n > (len(data) - _U32.size) // _U32.size:
        raise ValueError("ObjectEnums: a count beyond the block")
    return frozenset(struct.unpack_from(f"<{n}I", data, _U32.size))


def unchanged_of(data: bytes) -> frozenset[int]:
    """The kinds that Contents says are as before, and so not sent; behind a table of counts."""
    counts = _u32(data, 0, "Contents")
    start = _U32.size + HEADER.size * counts
    if start > len(data):
        raise ValueError("Contents: a count beyond the block")
    return kinds_of(data[start:])


def number_of(data: bytes) -> int:
    """FrameInfo's frame number."""
    return _u32(data, 0, "FrameInfo")


def period_of(data: bytes) -> int:
    """StreamInfo's frame period, in ticks of TICKS_HZ: of 1 to 10,000 Hz."""
    if len(data) < _I64.size:
        raise ValueError("StreamInfo: cut short")
    ticks: int = _I64.unpack_from(data)[0]
    if not TICKS_HZ // 10_000 <= ticks <= TICKS_HZ:
        raise ValueError("StreamInfo: a frame period that no camera has")
    return ticks


def subject_of(data: bytes) -> tuple[int, str, bytes]:
    """SubjectInfo: identifier, name, and its root segment's identifier, as it is written; there the body is."""
    identifier = _u32(data, 0, "SubjectInfo")
    name, at = _text(data, _U32.size, "SubjectInfo")
    if _u32(data, at, "SubjectInfo") == 0:
        raise ValueError("SubjectInfo: a subject without a segment")
    at += _U32.size
    if len(data) - at < _PARENTAGE.size:
        raise ValueError("SubjectInfo: cut short")
    # Segments come parents first; the identifier follows the parent's.
    return identifier, name, data[at + _U32.size : at + 2 * _U32.size]


def root_of(data: bytes, roots: Mapping[int, bytes]) -> tuple[int, bytes | None]:
    """GlobalSegments: whose they are, and its root among them, as SEGMENT; None where that is out of sight.

    roots: the root segment's identifier, as it is written, by the subject's.
    """
    if len(data) < HEADER.size:
        raise ValueError("GlobalSegments: cut short")
    subject, n = HEADER.unpack_from(data)
    if HEADER.size + n * SEGMENT.size != len(data):
        raise ValueError("GlobalSegments: count and length do not agree")
    root = roots.get(subject)
    if root is None:
        raise ValueError("GlobalSegments: a subject that is not named")
    for at in range(HEADER.size, len(data), SEGMENT.size):
        if data.startswith(root, at):
            return subject, data[at : at + SEGMENT.size]
    return subject, None


def latency_of(data: bytes) -> float:
    """LatencyInfo: the sum of its samples, s, from exposure to sending; each is called and counted from the last."""
    total, at = 0.0, _U32.size
    for _ in range(min(_u32(data, 0, "LatencyInfo"), len(data))):
        _, at = _text(data, at, "LatencyInfo")
        if len(data) - at < 8:
            raise ValueError("LatencyInfo: cut short")
        total += struct.unpack_from("<d", data, at)[0]
        at += 8
    if not (math.isfinite(total) and 0.0 <= total <= 1.0):
        raise ValueError("LatencyInfo: not between 0 and 1 s")
    return total


def _u32(data: bytes, at: int, what: str) -> int:
    if len(data) - at < _U32.size:
        raise ValueError(f"{what}: cut short")
    value: int = _U32.unpack_from(data, at)[0]
    return value


def _text(data: bytes, at: int, what: str) -> tuple[str, int]:
    """A string and where it ends."""
    start = at + _U32.size
    size = _u32(data, at, what)
    if size > len(data) - start:
        raise ValueError(f"{what}: a text beyond the block")
    return data[start : start + size].decode("utf-8", "replace"), start + size


READ = frozenset({Kind.CONTENTS, Kind.FRAME_INFO, Kind.GLOBAL_SEGMENTS, Kind.LATENCY_INFO})
"""A packet with blocks of other kinds is always taken apart."""
ONCE = (Kind.FRAME_INFO, Kind.LATENCY_INFO)
ROW = np.dtype([("identifier", "<u4"), ("row", "<f8", 12)])
LOST = bytes(SEGMENT.size)
"""Instead of a body out of sight, which some programs send themselves: it is at exactly zero."""
Rows = NDArray[np.float64]


def rows_of(segments: Sequence[bytes | None]) -> Rows:
    """Position, mm, and matrix, rows first, of each segment as SEGMENT (n, 12); zeros of one that is lost."""
    table: NDArray[Any] = np.frombuffer(b"".join([segment or LOST for segment in segments]), ROW)
    rows: Rows = table["row"]
    return rows


class Layout:
    """Of a packet of which nothing was refused; roots: each subject's root segment, as it is written."""

    def __init__(self, blocks: Sequence[Block], roots: Mapping[int, bytes]) -> None:
        self.changing: dict[int, slice] = {}
        """Where FRAME_INFO and LATENCY_INFO are."""
        whole = b"".join(HEADER.pack(kind, len(data)) + data for kind, data in blocks)
        changes = np.zeros(len(whole), np.bool_)
        root_at: dict[int, int] = {}
        at = 0
        for kind, data in blocks:
            at += HEADER.size
            if kind in ONCE:
                self.changing[kind] = slice(at, at + len(data))
                changes[at : at + len(data)] = True
            elif kind == Kind.GLOBAL_SEGMENTS:
                subject, n = HEADER.unpack_from(data)
                firsts = [at + HEADER.size + k * SEGMENT.size for k in range(n)]
                for first in firsts:
                    changes[first + 4 : first + SEGMENT.size] = True
                root_at.update((subject, at) for at in reversed(firsts) if whole.startswith(roots[subject], at))
            at += len(data)
        self._size = len(whole)
        self._same = np.flatnonzero(~changes)
        self._fixed_bytes = np.frombuffer(whole, np.uint8)[self._same].tobytes()
        self._seen = [k for k, subject in enumerate(roots) if subject in root_at]
        starts = [root_at[subject] + 4 for subject in roots if subject in root_at]
        self._row_bytes = np.array(starts, np.intp)[:, None] + np.arange(SEGMENT.size - 4)
        self._bodies = len(roots)

    def rows(self, packet: bytes) -> Rows | None:
        """As `rows_of`; None where the packet is laid out otherwise."""
        if len(packet) != self._size:
            return None
        data = np.frombuffer(packet, np.uint8)
        if data[self._same].tobytes() != self._fixed_bytes:
            return None
        seen: Rows = data[self._row_bytes].view("<f8")
        if len(self._seen) == self._bodies:
            return seen
        rows = np.zeros((self._bodies, 12))
        rows[self._seen] = seen
        return rows


def is_plain(kinds: Collection[int]) -> bool:
    """Whether a packet of these blocks may have a layout."""
    return READ.issuperset(kinds) and all(list(kinds).count(kind) <= 1 for kind in ONCE) and Kind.FRAME_INFO in kinds

"""How a packet is laid out, so that the next one, laid out the same, is not taken apart again. Pure.

From frame to frame only numbers change: the frame's own, the latencies, the segments' places. Whatever else is in a
packet (kinds, lengths, counts, identifiers) is compared byte by byte with one that was read, and found right, before.
"""

from collections.abc import Collection, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mocap.sources.vicon.packets import HEADER, SEGMENT, Block, Kind

READ = frozenset({Kind.CONTENTS, Kind.FRAME_INFO, Kind.GLOBAL_SEGMENTS, Kind.LATENCY_INFO})
"""A packet with blocks of other kinds is always taken apart."""
ONCE = (Kind.FRAME_INFO, Kind.LATENCY_INFO)
ROW = np.dtype([("identifier", "<u4"), ("row", "<f8", 12)])
LOST = bytes(SEGMENT.size)
"""Instead of a body out of sight, which some programs send themselves: it is at exactly zero."""
Rows = NDArray[np.float64]


def rows_of(segments: Sequence[bytes | None]) -> Rows:
    """Position, mm, and matrix, rows first, of each segment as objects.SEGMENT (n, 12); zeros of one that is lost."""
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

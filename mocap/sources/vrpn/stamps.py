"""A pose's time on the server's one clock, where stamps can be used: each tracker has a clock of its own. Pure.

A clock that is off is found by its stamps less their arrivals, against those of the other bodies. Stamps that step more
coarsely than poses come say nothing of the exposure: then arrivals are used.
"""

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field
from statistics import median, median_low

STRAY_NS = 1_000_000_000
"""A tracker's clock that is farther from the others' is off."""
JUDGED, REPEATED_SHARE = 64, 0.15
"""Stamps are judged by so many poses of one body; they step coarsely where this share repeats the one before."""


@dataclass(slots=True)
class _Track:
    """One body's newest stamp and pose, what its clock is ahead of arrivals and of the others', its last steps, ns."""

    stamp_ns: int = 0
    pose: bytes = b""
    ahead_ns: int = 0
    off_ns: int = 0
    steps_ns: deque[int] = field(default_factory=lambda: deque(maxlen=JUDGED))


class Stamps:
    """Of one connection. coarse_ns: the step of stamps that are not used; 0 where they are."""

    def __init__(self) -> None:
        self.coarse_ns = 0
        self._tracks: dict[int, _Track] = {}
        self._base_ns = 0

    def time_ns(self, row: int, stamp_ns: int, pose: bytes, now_ns: int) -> int:
        """The time of a pose that came now; stamp_ns: 0 for none."""
        if self.coarse_ns or not stamp_ns:
            return now_ns
        track = self._tracks.setdefault(row, _Track())
        if self._is_coarse(track, stamp_ns, pose):
            return now_ns
        track.ahead_ns = stamp_ns - now_ns
        if abs(track.ahead_ns - track.off_ns - self._base_ns) > STRAY_NS:
            self._compare()
        return stamp_ns - track.off_ns

    def off_s(self) -> Iterator[tuple[int, float]]:
        """The rows whose clocks are off, and by how much."""
        return ((row, track.off_ns * 1e-9) for row, track in self._tracks.items() if track.off_ns)

    def _compare(self) -> None:
        """The clock of most bodies is the one to go by."""
        self._base_ns = median_low(track.ahead_ns for track in self._tracks.values())
        for track in self._tracks.values():
            off_ns = track.ahead_ns - self._base_ns
            track.off_ns = off_ns if abs(off_ns) > STRAY_NS else 0

    def _is_coarse(self, track: _Track, stamp_ns: int, pose: bytes) -> bool:
        """Whether the stamps of this body step more coarsely than its poses come."""
        if pose == track.pose:
            return False
        steps, before_ns = track.steps_ns, track.stamp_ns
        track.stamp_ns, track.pose = stamp_ns, pose
        if before_ns:
            steps.append(stamp_ns - before_ns)
        if len(steps) == JUDGED and steps.count(0) > REPEATED_SHARE * JUDGED:
            self.coarse_ns = round(median([step for step in steps if step > 0] or [STRAY_NS]))
        return self.coarse_ns > 0

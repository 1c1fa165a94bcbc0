"""Exposures from poses that come one by one: those of one stamp, or nearly, within a deadline. Pure.

A second copy of a pose is nothing new. The bodies that came with the exposure before are waited for, so that an
exposure is out as soon as it is whole, and a body that is hidden is waited for once.
"""

from dataclasses import dataclass, field

OUT_OF_ORDER_NS = 100_000_000
"""A stamp so much before the newest is late; one still earlier is that of a clock which was set."""


@dataclass(slots=True)
class Exposure:
    """Poses of one time: the stamp of the first that came, when it came, and each body's 56 bytes by its row."""

    stamp_ns: int
    arrived_ns: int
    poses: dict[int, bytes] = field(default_factory=dict)


class Assembly:
    """longest_ns: how long an exposure waits for its last pose, and how far apart its stamps may be."""

    def __init__(self, longest_ns: int) -> None:
        self.late = 0
        """Poses of an exposure that was out already."""
        self._longest_ns = self._window_ns = longest_ns
        self._open: Exposure | None = None
        self._last: Exposure | None = None
        self._newest: dict[int, tuple[int, bytes]] = {}
        self._ready: list[Exposure] = []

    @property
    def due_ns(self) -> int | None:
        """When `take` is to be called at the latest; None while nothing waits."""
        return None if self._open is None else self._open.arrived_ns + self._longest_ns

    def set_period(self, period_ns: float) -> None:
        """How far exposures are apart: stamps of one are nearer to each other than to those of the next."""
        self._window_ns = min(self._longest_ns, round(0.4 * period_ns))

    def add(self, row: int, stamp_ns: int, pose: bytes, now_ns: int) -> None:
        """One body's pose has come."""
        if self._newest.get(row) == (stamp_ns, pose):
            return
        self._newest[row] = stamp_ns, pose
        current = self._open
        if current is not None:
            if abs(stamp_ns - current.stamp_ns) <= self._window_ns:
                had = current.poses.setdefault(row, pose)
                if had == pose:
                    return
            elif self._is_of_last(row, stamp_ns, pose) or self._is_late(stamp_ns, current):
                return
            self._close()
        elif self._is_of_last(row, stamp_ns, pose) or self._is_late(stamp_ns, self._last):
            return
        self._open = Exposure(stamp_ns, now_ns, {row: pose})

    def pop_ready(self, now_ns: int) -> list[Exposure]:
        """Exposures that are whole, or have waited long enough; to be called when all that came was added."""
        due_ns = self.due_ns
        if due_ns is not None and (now_ns >= due_ns or self._is_whole()):
            self._close()
        ready, self._ready = self._ready, []
        return ready

    def _is_of_last(self, row: int, stamp_ns: int, pose: bytes) -> bool:
        """Whether it belongs to the exposure that is out: a second copy, or one too late (which is counted)."""
        last = self._last
        if last is None or abs(stamp_ns - last.stamp_ns) > self._window_ns:
            return False
        if row not in last.poses:
            last.poses[row] = pose
            self.late += 1
            return True
        return last.poses[row] == pose

    def _is_late(self, stamp_ns: int, newest: Exposure | None) -> bool:
        if newest is None or not self._window_ns < newest.stamp_ns - stamp_ns <= OUT_OF_ORDER_NS:
            return False
        self.late += 1
        return True

    def _is_whole(self) -> bool:
        return self._open is not None and self._last is not None and self._open.poses.keys() >= self._last.poses.keys()

    def _close(self) -> None:
        if self._open is not None:
            self._ready.append(self._open)
            self._last, self._open = self._open, None

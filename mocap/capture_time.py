"""When a frame was exposed, on our clock, from the stamps of another clock: of one way, or of both. Pure.

What arrives is late by an unknown, changing delay and never early, so the truth lies along the lower edge of
`arrival - stamp`. That edge's offset and slope (two clocks part by tens of parts in a million) are those of the line
under all points of the last seconds that is nearest to them: an edge of their lower convex hull (Moon, Skelly, Towsley:
Estimation and removal of clock skew from network delay measurements, 1999). Bursts and stalls only lie above it.
"""

from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass, field
from itertools import pairwise
from statistics import median

BUCKET_NS = 250_000_000
WINDOW = 120
"""The least of each bucket is kept; so many buckets are remembered."""
STEP_NS = 2_000_000
"""A point farther below the line shows that a clock was set, or that the path became shorter."""
ABOVE_NS, ABOVE_SCATTERS = 3_000_000_000, 3
"""After so long with every point more than ABOVE_SCATTERS scatters above the line, the line starts over."""

Point = tuple[int, int]


@dataclass(slots=True)
class LowerEdge:
    """The least of a delay-laden difference of two clocks, as a line in time: it may drift, and be stepped.

    steepest: largest drift, s/s. slope_ns: the slope is believed when the points span so much. unsure_ns: how far a
    point may be below the line until then, STEP_NS afterwards.
    """

    steepest: float = 1e-3
    slope_ns: int = 6_000_000_000
    unsure_ns: int = STEP_NS
    _points: deque[Point] = field(default_factory=lambda: deque(maxlen=WINDOW))
    _line: tuple[int, int, float] | None = None
    _touched_ns: int = 0
    _above: Point | None = None
    scatter_ns: int = 0
    """Median height of the buckets' least values above the edge: the edge's uncertainty."""

    def offer(self, now_ns: int, value_ns: int) -> None:
        """A difference as of now: the truth plus a delay."""
        line_ns = self.at_ns(now_ns)
        if line_ns is None or value_ns < line_ns - (STEP_NS if self._is_sure else self.unsure_ns):
            self._restart(now_ns, value_ns)
        elif value_ns - line_ns <= max(STEP_NS, ABOVE_SCATTERS * self.scatter_ns):
            self._touched_ns, self._above = now_ns, None
        else:
            self._above = min(self._above or (now_ns, value_ns), (now_ns, value_ns), key=lambda p: p[1])
            if now_ns - self._touched_ns > ABOVE_NS:
                self._restart(*self._above)
        self._add((now_ns, value_ns))

    def at_ns(self, now_ns: int) -> int | None:
        """The edge at that time; None before the first point."""
        if self._line is None:
            return None
        t_ns, value_ns, slope = self._line
        return value_ns + round((now_ns - t_ns) * slope)

    def restart(self) -> None:
        """Start over: for a new connection, or after a clock was set."""
        self._points.clear()
        self._line = None

    @property
    def _is_sure(self) -> bool:
        return self._points[-1][0] - self._points[0][0] >= self.slope_ns

    def _restart(self, now_ns: int, value_ns: int) -> None:
        slope = self._line[2] if self._line is not None else 0.0
        self._points.clear()
        self._line = now_ns, value_ns, slope
        self._touched_ns = now_ns
        self._above = None

    def _add(self, point: Point) -> None:
        while self._points and self._points[-1][0] // BUCKET_NS > point[0] // BUCKET_NS:
            self._points.pop()  # frames that were counted as lost have come: a count goes back
        last = self._points[-1] if self._points else None
        if last is None or point[0] // BUCKET_NS != last[0] // BUCKET_NS:
            self._points.append(point)
        elif point[1] < last[1]:
            self._points[-1] = point
        else:
            return
        self._fit()

    def _fit(self) -> None:
        """The edge of the hull over the middle of the points; with few of them, the slope is the one known."""
        slope = self._line[2] if self._line is not None else 0.0
        points = self._points
        if self._is_sure:
            a, b = _edge_over(_lower_hull(points), (points[0][0] + points[-1][0]) // 2)
            slope = min(max((b[1] - a[1]) / (b[0] - a[0]), -self.steepest), self.steepest)
        t0, _ = points[0]
        lowest = min(points, key=lambda p: p[1] - slope * (p[0] - t0))
        self._line = lowest[0], lowest[1], slope
        self.scatter_ns = round(median(value - lowest[1] - (t - lowest[0]) * slope for t, value in points))


@dataclass(slots=True)
class CaptureTime:
    """Exposures on our clock from a source's stamps.

    latency_ns: the constant part of the delay from exposure to receipt, used where only stamps come. With clock echoes
    (`exchange`) the delay is measured instead.
    """

    latency_ns: int
    _down: LowerEdge = field(default_factory=LowerEdge)
    _echo_down: LowerEdge = field(default_factory=LowerEdge)
    _echo_up: LowerEdge = field(default_factory=LowerEdge)
    _stamp_ns: int | None = None

    def exchange(self, sent_ns: int, theirs_ns: int, now_ns: int) -> None:
        """A request sent at `sent_ns` was answered at `theirs_ns` of their clock and heard at `now_ns`."""
        if now_ns >= sent_ns:
            self._echo_up.offer(now_ns, theirs_ns - sent_ns)
            self._echo_down.offer(now_ns, now_ns - theirs_ns)

    def capture_ns(self, stamp_ns: int, now_ns: int) -> int:
        """The exposure that they stamped `stamp_ns` and that came now; never later than now."""
        if self._stamp_ns is not None and stamp_ns < self._stamp_ns - STEP_NS:
            self._down.restart()
        self._stamp_ns = stamp_ns
        self._down.offer(now_ns, now_ns - stamp_ns)
        offset_ns = self.offset_ns(now_ns)
        if offset_ns is not None:
            return min(stamp_ns + offset_ns, now_ns)
        return min(stamp_ns + (self._down.at_ns(now_ns) or 0) - self.latency_ns, now_ns)

    def offset_ns(self, now_ns: int) -> int | None:
        """Our clock minus theirs by the echoes, delays of both ways taken as equal at their least; None without."""
        up_ns = self._echo_up.at_ns(now_ns)
        down_ns = None if up_ns is None else self._echo_down.at_ns(now_ns)
        return None if up_ns is None or down_ns is None else (down_ns - up_ns) // 2

    def uncertainty_ns(self, now_ns: int) -> int | None:
        """How far a capture time may be off, apart from the constant where no echo is heard; None before any frame."""
        up_ns, down_ns = self._echo_up.at_ns(now_ns), self._echo_down.at_ns(now_ns)
        if up_ns is not None and down_ns is not None:
            return (up_ns + down_ns) // 2
        return None if self._down.at_ns(now_ns) is None else self._down.scatter_ns


def _lower_hull(points: Iterable[Point]) -> list[Point]:
    """The points of rising abscissa on the lower convex hull."""
    hull: list[Point] = []
    for p in points:
        while len(hull) > 1 and _turns_down(hull[-2], hull[-1], p):
            hull.pop()
        hull.append(p)
    return hull


def _turns_down(a: Point, b: Point, c: Point) -> bool:
    return (b[1] - a[1]) * (c[0] - b[0]) >= (c[1] - b[1]) * (b[0] - a[0])


def _edge_over(hull: list[Point], t_ns: int) -> tuple[Point, Point]:
    """The hull's edge over the abscissa `t_ns`."""
    for a, b in pairwise(hull):
        if b[0] >= t_ns:
            return a, b
    return hull[-2], hull[-1]

"""When frames were exposed whose stamps are only the times at which they arrived. Pure.

Cameras expose evenly, so a frame's number is a clock of theirs: an arrival less the number's time is the truth plus a
delay, of which `LowerEdge` follows the least. Frames that were held back lie above it.
Where numbers never skip, a gap shows what was lost: frames that lag by periods and do not catch up follow lost ones.
"""

from collections import deque
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from mocap.capture_time import LowerEdge
from mocap.figures import CAUGHT_UP, GAP, is_stamped_on_arrival

WINDOW, JUDGED = 200, 20
"""Stamps are judged by so many frames, every so many; from the same the first period is learnt."""
SLOPE_NS, SLOPE_SHARE = 1_000_000_000, 0.05
"""Over so long the frames' own spacing counts, within this share of the first period."""
LAGGING, LAG_SHARE = 3, 0.9
"""So many frames after a gap that lag by this share of a period and do not catch up show that frames were lost."""
LONGEST_GAP, LATE = 1000, 16
"""Frames: a larger step of the numbers, or so many back, is of another count; fewer back, of a frame overtaken."""
GOES_ON = 3
"""So many frames of another count in a row show that it goes on; fewer are strays of another publisher."""


@dataclass(slots=True)
class FrameOrder:
    """Which frames are new, by their numbers. lost: those of this count that never came in their turn.

    Frames that were overtaken, repeated, or are strays of another count change nothing. Another count that goes on,
    without one of ours between, takes its place: the cameras were started again.
    """

    newest: int | None = None
    lost: int = 0
    _stray: int = 0
    _in_a_row: int = 0

    def receive(self, number: int) -> int | None:
        """How far the number is above the newest; 0 where it begins anew, None for a frame that is out of order."""
        step = 1 if self.newest is None else number - self.newest
        if self.newest is not None and not 0 < step <= LONGEST_GAP:
            if -LATE <= step <= 0:
                return None
            goes_on = self._in_a_row > 0 and 0 < number - self._stray <= LONGEST_GAP
            self._stray, self._in_a_row = number, self._in_a_row + 1 if goes_on else 1
            if self._in_a_row < GOES_ON:
                return None
            step = 0
        self.newest, self._in_a_row = number, 0
        self.lost += max(step - 1, 0)
        return step


@dataclass(slots=True)
class ExposureLine:
    """Exposures of evenly spaced frames from the arrivals of numbered ones.

    period_ns: between frames, nearly. numbers_skip: whether lost frames show in the numbers; else `lost` counts them.
    """

    period_ns: float
    numbers_skip: bool = False
    lost: int = 0
    _number: int = 0
    _arrived_ns: int = 0
    _has_gap: bool = False
    """Whether there was a gap since the last frame that was on the line."""
    _lags_ns: deque[float] = field(default_factory=lambda: deque(maxlen=LAGGING))
    _edge: LowerEdge = field(
        default_factory=lambda: LowerEdge(SLOPE_SHARE, SLOPE_NS, unsure_ns=round(SLOPE_SHARE * SLOPE_NS))
    )

    @property
    def scatter_ns(self) -> int:
        """Median height of the least late frames above the line: its uncertainty."""
        return self._edge.scatter_ns

    def exposed_ns(self, steps: int, arrived_ns: int) -> int:
        """The exposure of the frame `steps` numbers after the last one; never later than its arrival."""
        spacing_ns = arrived_ns - self._arrived_ns
        self._number, self._arrived_ns = self._number + steps, arrived_ns
        self.numbers_skip = self.numbers_skip or steps > 1
        line_ns = self._line_ns()
        if line_ns is not None and not self.numbers_skip:
            self._count_lost(arrived_ns - line_ns, spacing_ns)
        theirs_ns = self._theirs_ns()
        self._edge.offer(theirs_ns, arrived_ns - theirs_ns)
        return min(self._line_ns() or arrived_ns, arrived_ns)

    def _theirs_ns(self) -> int:
        return round(self._number * self.period_ns)

    def _line_ns(self) -> int | None:
        theirs_ns = self._theirs_ns()
        offset_ns = self._edge.at_ns(theirs_ns)
        return None if offset_ns is None else theirs_ns + offset_ns

    def _count_lost(self, late_ns: float, spacing_ns: int) -> None:
        """Count the frames that were lost without a gap in the numbers; count them back if they were merely late."""
        is_gap = spacing_ns >= GAP * self.period_ns
        self._has_gap = (self._has_gap or is_gap) and late_ns >= LAG_SHARE * self.period_ns
        if is_gap or not self._has_gap or spacing_ns < CAUGHT_UP * self.period_ns:
            self._lags_ns.clear()
        if self._has_gap and spacing_ns >= CAUGHT_UP * self.period_ns:
            self._lags_ns.append(late_ns)
        more = 0
        if len(self._lags_ns) == LAGGING:
            more = round(min(self._lags_ns) / self.period_ns)
            self._lags_ns.clear()
        elif late_ns < -LAG_SHARE * self.period_ns:
            more = -min(round(-late_ns / self.period_ns), self.lost)
        self.lost += more
        self._number += more


@dataclass(slots=True)
class Retiming:
    """Capture times of one source: its stamps where they are exposures; re-timed where they are arrival times.

    is_numbered: whether the source itself numbers its frames; else each is the next. A new count of frames starts over:
    another publisher may stamp otherwise. restarted: whether the newest frame began one.
    """

    is_numbered: bool = True
    restarted: bool = False
    _order: FrameOrder = field(default_factory=FrameOrder)
    _line: ExposureLine | None = None
    _stamp_ns: int | None = None
    _spacings_ns: deque[int] = field(default_factory=lambda: deque(maxlen=WINDOW))
    _steps: deque[int] = field(default_factory=lambda: deque(maxlen=WINDOW))
    _count: int = 0

    @property
    def scatter_ns(self) -> int | None:
        """The residual scatter of re-timed captures; None where stamps are exposures."""
        return None if self._line is None else self._line.scatter_ns

    def capture_ns(self, seq: int, stamp_ns: int, is_stamped: bool) -> int | None:
        """The exposure of frame `seq`, never later than stamp_ns: its stamp, or its arrival less the latency.

        None for a frame that is out of order.
        """
        steps = self._order.receive(seq) if self.is_numbered else 1
        if steps is None:
            return None
        before_ns, self._stamp_ns = self._stamp_ns, stamp_ns
        self.restarted = steps == 0
        if before_ns is None or steps == 0:
            self._line, self._count = None, 0
            self._spacings_ns.clear()
            self._steps.clear()
        elif self._line is None:
            self._spacings_ns.append(stamp_ns - before_ns)
            self._steps.append(steps)
            self._count += 1
            if self._count >= WINDOW and self._count % JUDGED == 0:
                self._judge(is_stamped)
        return stamp_ns if self._line is None else self._line.exposed_ns(steps, stamp_ns)

    def _judge(self, is_stamped: bool) -> None:
        """Decide by the last frames; their usual spacing is the period."""
        spacings_ns, steps = np.array(self._spacings_ns, float), np.array(self._steps)
        period_ns = usual_period_ns(spacings_ns / steps)
        is_catching_up = spacings_ns[-1] < CAUGHT_UP * period_ns
        # A rhythm fills most of the time that has passed. Frames that waited together, for a process to begin, do not.
        periods = spacings_ns / (period_ns * steps)
        in_rhythm_ns = spacings_ns[(periods > CAUGHT_UP) & (periods < GAP)].sum()
        if (
            2.0 * in_rhythm_ns > spacings_ns.sum()
            and not is_catching_up
            and (not is_stamped or is_stamped_on_arrival(spacings_ns, steps))
        ):
            self._line = ExposureLine(period_ns, max(self._steps) > 1)


def usual_period_ns(spacings_ns: NDArray[np.float64]) -> float:
    """The median of the spacings that are no bursts."""
    return float(np.median(spacings_ns[spacings_ns >= CAUGHT_UP * np.median(spacings_ns)]))


def exposures_ns(stamps_ns: NDArray[np.int64]) -> NDArray[np.int64]:
    """Exposures (k,) of a whole recording without frame numbers: its stamps, re-timed where they are arrival times.

    Where frames were lost is known afterwards: the first ones behind a gap have their times, too. A few near a burst
    may not rise.
    """
    spacings_ns = np.diff(stamps_ns).astype(float)
    if len(spacings_ns) < WINDOW or not is_stamped_on_arrival(spacings_ns, np.ones(len(spacings_ns))):
        return stamps_ns
    line = ExposureLine(usual_period_ns(spacings_ns))
    out = np.zeros(len(stamps_ns), np.int64)
    for k, stamp_ns in enumerate(stamps_ns.tolist()):
        lost = line.lost
        out[k] = line.exposed_ns(1, stamp_ns)
        if line.lost > lost:
            out[k + 1 - LAGGING : k] += round((line.lost - lost) * line.period_ns)
    return np.minimum(out, stamps_ns)

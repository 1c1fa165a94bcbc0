"""How exposures follow each other: numbers for those that come without, and how many never came. Pure."""

from collections import deque
from statistics import fmean, median

REMEMBERED, ENOUGH = 64, 16
GAIN = 0.1
"""How far the even rhythm is moved towards each stamp."""
LONGEST_GAP_NS = 1_000_000_000
"""Nothing for longer than this is no loss of frames: nobody was in sight, or the server paused."""


class Pacing:
    """One source's, over all its connections. period_ns: as configured, until it is measured by the stamps."""

    def __init__(self, period_ns: float) -> None:
        self.period_ns = period_ns
        self.lost = 0
        """Exposures that a gap in the stamps shows, less those that were merely stamped late."""
        self._seq = -1
        self._stamp_ns: int | None = None
        self._steps: deque[int] = deque(maxlen=REMEMBERED)
        self._late_ns = 0.0
        """How much later the last stamp was than an even rhythm has it."""
        self._learnt = 0
        self._doubtful = 0

    def restart(self) -> None:
        """A new connection: its stamps are not compared with those before."""
        self._stamp_ns = None
        self._late_ns = 0.0
        self._doubtful = 0

    def number(self, stamp_ns: int) -> int:
        """The next exposure's number: one more, and one more for each that is missing before it."""
        missing, last_ns = 0, self._stamp_ns
        self._stamp_ns = stamp_ns
        if last_ns is not None and 0 <= stamp_ns - last_ns <= LONGEST_GAP_NS:
            missing = self._missing(stamp_ns - last_ns)
        self._seq += 1 + missing
        return self._seq

    def _missing(self, step_ns: int) -> int:
        if len(self._steps) < ENOUGH:
            self._learn(step_ns)
            return 0
        since_ns, period_ns = self._late_ns + step_ns, self.period_ns
        steps = round(since_ns / period_ns)
        if self._doubtful and steps < 1:  # it was not lost, but stamped late
            self._doubtful -= 1
            self.lost -= 1
            return 0
        missing = max(steps - 1, 0)
        if missing:
            self._doubtful = missing
        self.lost += missing
        self._late_ns = (1.0 - GAIN) * max(since_ns - (1 + missing) * period_ns, -0.5 * period_ns)
        self._learn(step_ns)
        return missing

    def _learn(self, step_ns: int) -> None:
        """The mean of the steps that are one period long: most of them."""
        self._steps.append(step_ns)
        self._learnt += 1
        if self._learnt % ENOUGH == 0:
            middle_ns = median(self._steps)
            near = [step for step in self._steps if abs(step - middle_ns) <= 0.5 * middle_ns]
            self.period_ns = max(fmean(near or self._steps), 1.0)

"""Capture times held against arrivals: a source that runs ahead of, or behind, what it did before. Pure."""

from dataclasses import dataclass, field

from wire.clock_offset import LeastDelay
from wire.transport.frame_check import AHEAD_NS

SETTLED_FRAMES = 50
EARLY_NS = 10_000_000
"""How much less than the least delay known a delay may be."""
LATE_NS = 150_000_000
"""How much more: what is older is no place to fly by."""
RELEARN_FRAMES = 50


@dataclass(slots=True)
class StampWatch:
    """One source's least delay, from exposure to arrival."""

    _least: LeastDelay = field(default_factory=LeastDelay)
    _frames: int = 0
    _refused: int = 0

    def refuses(self, t_capture_ns: int, now_ns: int, in_flight: bool) -> bool:
        """Whether the stamp cannot be right. One that stays wrong is another rhythm, taken up when nobody flies."""
        delay_ns = now_ns - t_capture_ns
        least_ns = self._least.at_ns(now_ns)
        settled = least_ns is not None and self._frames >= SETTLED_FRAMES
        if delay_ns >= -AHEAD_NS and settled and least_ns is not None:
            wrong = not -EARLY_NS <= delay_ns - least_ns <= LATE_NS
            if wrong and not in_flight and self._refused >= RELEARN_FRAMES:
                self._least, self._frames, wrong = LeastDelay(), 0, False
        else:
            wrong = delay_ns < -AHEAD_NS
        if wrong:
            self._refused += 1
            return True
        self._least.offer(delay_ns, now_ns)
        self._frames, self._refused = self._frames + 1, 0
        return False

    def likely_ns(self, now_ns: int) -> int:
        """When what arrives now was captured, if it took as long as the quickest did."""
        return now_ns - max(self._least.at_ns(now_ns) or 0, 0)

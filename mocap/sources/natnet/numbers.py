"""Losses by the frames' numbers."""

from dataclasses import dataclass

LATE = 16
"""A number so little behind belongs to a frame that another overtook; farther behind, numbering began anew."""
LONGEST_GAP = 10_000


@dataclass(slots=True)
class FrameNumbers:
    """Which frames are new. lost: those that never came.

    skipped: whether some are missing before the newest; restarted: whether the newest begins another count.
    """

    lost: int = 0
    skipped: bool = False
    restarted: bool = False
    _newest: int | None = None

    def receive(self, number: int) -> bool:
        """Whether the frame is new: neither repeated nor overtaken by a later one."""
        step = 1 if self._newest is None else number - self._newest
        if -LATE <= step <= 0:
            return False
        self.restarted = not 0 < step <= LONGEST_GAP
        self.skipped = step > 1 and not self.restarted
        self.lost += step - 1 if self.skipped else 0
        self._newest = number
        return True

"""Lost and repeated frames by frame number. Pure."""

from collections import deque
from dataclasses import dataclass, field

REMEMBERED = 64
LONGEST_GAP = 1000
"""A larger step means that the server's count started over."""


@dataclass(slots=True)
class FrameCount:
    """Numbers that rise by one a frame, or by more where the cameras are faster than what is sent."""

    lost: int = 0
    _number: int | None = None
    _seq: int = -1
    _steps: deque[int] = field(default_factory=lambda: deque(maxlen=REMEMBERED))

    def receive(self, number: int) -> int | None:
        """Our number of the frame with the server's `number`, with gaps for lost frames; None for a repeated frame."""
        last, self._number = self._number, number
        if last is None:
            self._seq += 1
        elif number == last:
            return None
        else:
            self._seq += self._frames(number - last)
        return self._seq

    def _frames(self, step: int) -> int:
        """How many frames a step is: the usual step is the least of the last ones."""
        if step <= 0:
            self._steps.clear()
            return 1
        self._steps.append(step)
        frames = round(step / min(self._steps))
        if frames > LONGEST_GAP:
            self._steps.clear()
            return 1
        self.lost += frames - 1
        return frames

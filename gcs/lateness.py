"""How regularly frames come, and which were missed: the count of late ticks."""

from dataclasses import dataclass
from math import exp

MEMORY_S = 1.0


@dataclass(slots=True)
class Lateness:
    """Frames by sequence number. A frame is missed when its number never comes, or a newer one overtakes it unused."""

    frames: int = 0
    missed: int = 0
    _seq: int | None = None
    _t_ns: int = 0
    _late: float = 0.0
    _all: float = 0.0

    @property
    def share(self) -> float:
        """The part of about the last second's frames that was missed, 0..1."""
        return self._late / self._all if self._all > 0.0 else 0.0

    def note(self, seq: int, now_ns: int, overtaken: bool) -> None:
        """A frame came; `overtaken`: the one before it was never used. A source that starts again starts again here."""
        missed = int(overtaken)
        if self._seq is not None and seq > self._seq:
            missed += seq - self._seq - 1
        fade = exp(-(now_ns - self._t_ns) * 1e-9 / MEMORY_S)
        self._late = self._late * fade + missed
        self._all = self._all * fade + missed + 1
        self.frames, self.missed = self.frames + 1, self.missed + missed
        self._seq, self._t_ns = seq, now_ns

"""Packet loss by sequence number, and two senders under one identity. It knows nothing of what packets say."""

from dataclasses import dataclass, replace
from math import exp

MODULO = 256
FORWARD = 128  # a step this long or longer is a step back: a packet overtaken on the way
NEAR = 4  # a stream is recognised by a step this short
CAME_MASK = (1 << NEAR + 1) - 1
FORGET_NS = 500_000_000
MEMORY_S = 1.0
TURNS, TURNS_SHARE = 4.0, 0.15


@dataclass(slots=True)
class _Stream:
    """A counter that goes on: its newest number, and which of those just behind it came (bit k: k before it)."""

    seq: int
    heard_ns: int
    came: int = 1

    def advance(self, step: int, now_ns: int) -> None:
        """Go on to the number `step` further."""
        self.seq = (self.seq + step) % MODULO
        self.heard_ns = now_ns
        self.came = (self.came << step | 1) & CAME_MASK

    def repeats(self, behind: int) -> bool:
        """Whether the number that far behind the newest had come before; it has now."""
        before = self.came
        self.came |= 1 << behind
        return self.came == before


@dataclass(slots=True)
class SequenceMonitor:
    """One sender's sequence numbers (0..255, one more each packet).

    Two senders that use the same address show as two interleaved counters: each packet continues one of two streams,
    and the stream changes again and again; where the counters are close, numbers come twice. A lone sender never
    returns to a counter it has left, and what a network delays on the way fills a gap, once.
    """

    received: int = 0
    lost: int = 0
    _skipped: int = 0
    _stream: _Stream | None = None
    _other: _Stream | None = None
    _turns: float = 0.0
    _packets: float = 0.0
    _noted_ns: int = 0

    @property
    def loss(self) -> float:
        """The part of the packets that never came, 0..1."""
        sent = self.received + self.lost
        return self.lost / sent if sent else 0.0

    def duplicate(self, now_ns: int) -> bool:
        """Whether two senders were heard in turns in about the last second."""
        if self._turns < TURNS or self._turns < TURNS_SHARE * self._packets:
            return False
        return self._turns * exp(-(now_ns - self._noted_ns) * 1e-9 / MEMORY_S) >= TURNS

    def note(self, seq: int, now_ns: int, skipped: int = 0) -> None:
        """A packet with this number came; `skipped` others came since the last, before it or after, not for us."""
        self.received += 1
        self._skipped += skipped
        if self._stream is None:
            self._stream, self._noted_ns = _Stream(seq, now_ns), now_ns
            return
        self._count(self._turn(self._stream, seq, now_ns), now_ns)

    def _turn(self, stream: _Stream, seq: int, now_ns: int) -> bool:
        """Place the number on a stream; whether a lone sender would not have sent it now."""
        step = (seq - stream.seq) % MODULO
        behind = -step % MODULO
        if behind <= NEAR:
            return self._look_back(stream, behind)
        if step > NEAR and self._other is not None and self._goes_on(self._other, seq, now_ns):
            self._stream, self._other = self._other, stream
            return True
        if step >= FORWARD:  # too far back to be overtaken on the way: the counter is another one
            self._stream, self._other = _Stream(seq, now_ns), stream
            return False
        if step > NEAR:
            self._other = replace(stream)
        stream.advance(step, now_ns)
        explained = min(self._skipped, step - 1)
        self._skipped -= explained
        self.lost += step - 1 - explained
        return False

    def _look_back(self, stream: _Stream, behind: int) -> bool:
        if stream.repeats(behind):
            return True
        self.lost = max(self.lost - 1, 0)  # late, not lost
        return False

    def _goes_on(self, other: _Stream, seq: int, now_ns: int) -> bool:
        step = (seq - other.seq) % MODULO
        if now_ns - other.heard_ns >= FORGET_NS or not 0 < step <= NEAR:
            return False
        other.advance(step, now_ns)
        return True

    def _count(self, turned: bool, now_ns: int) -> None:
        fade = exp(-(now_ns - self._noted_ns) * 1e-9 / MEMORY_S)
        self._noted_ns = now_ns
        self._turns = self._turns * fade + turned
        self._packets = self._packets * fade + 1.0

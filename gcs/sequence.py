"""Packet loss by sequence number, and two senders under one identity. It knows nothing of what packets say."""

from dataclasses import dataclass
from math import exp

MODULO = 256
FORWARD = 128  # a step this long or longer is a step back: a packet overtaken on the way
NEAR = 4  # a stream is recognised by a step this short
FORGET_NS = 500_000_000
MEMORY_S = 1.0
TURNS, TURNS_SHARE = 4.0, 0.15


@dataclass(slots=True)
class _Stream:
    seq: int
    heard_ns: int


@dataclass(slots=True)
class SequenceWatch:
    """One sender's sequence numbers (0..255, one more each packet).

    Two senders that use the same address show as two interleaved counters: each packet continues one of two streams,
    and the stream changes again and again; where the counters are close, every other packet steps back. A lone sender
    never returns to a counter it has left, and a network that overtakes does so now and then.
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
        faded = self._turns * exp(-(now_ns - self._noted_ns) * 1e-9 / MEMORY_S)
        return faded >= TURNS and self._turns >= TURNS_SHARE * self._packets

    def note(self, seq: int, now_ns: int, skipped: int = 0) -> None:
        """A packet with this number came; `skipped` others came since the last, before it or after, not for us."""
        self.received += 1
        self._skipped += skipped
        heard = _Stream(seq, now_ns)
        if self._stream is None:
            self._stream, self._noted_ns = heard, now_ns
            return
        step = (seq - self._stream.seq) % MODULO
        turned = step == 0 or step >= MODULO - NEAR
        if step > NEAR and self._continues_other(heard):
            self._stream, self._other, turned = heard, self._stream, True
        elif 0 < step < FORWARD:
            if step > NEAR:
                self._other = self._stream
            self._stream = heard
            explained = min(self._skipped, step - 1)
            self._skipped -= explained
            self.lost += step - 1 - explained
        elif not turned:  # not just overtaken or repeated on the way: the counter is another one
            self._stream, self._other = heard, self._stream
        self._count(turned, now_ns)

    def _count(self, turned: bool, now_ns: int) -> None:
        fade = exp(-(now_ns - self._noted_ns) * 1e-9 / MEMORY_S)
        self._noted_ns = now_ns
        self._turns = self._turns * fade + turned
        self._packets = self._packets * fade + 1.0

    def _continues_other(self, heard: _Stream) -> bool:
        other = self._other
        if other is None or heard.heard_ns - other.heard_ns >= FORGET_NS:
            return False
        return 0 < (heard.seq - other.seq) % MODULO <= NEAR

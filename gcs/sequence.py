"""Packet loss by sequence number, and two senders under one identity. It knows nothing of what packets say."""

from dataclasses import dataclass, field

MODULO = 256
FORWARD = 128  # a step this long or longer is a step back: a packet overtaken on the way
NEAR = 4  # a stream is recognised by a step this short
SWITCHES = 6
WINDOW_NS = 2_000_000_000
FORGET_NS = 500_000_000


@dataclass(slots=True)
class _Stream:
    seq: int
    heard_ns: int


@dataclass(slots=True)
class SequenceWatch:
    """One sender's sequence numbers (0..255, one more each packet).

    Two senders that use the same address show as two interleaved counters: each packet continues one of two streams,
    and the stream changes again and again. A lone sender never returns to a counter it has left.
    """

    received: int = 0
    lost: int = 0
    _skipped: int = 0
    _stream: _Stream | None = None
    _other: _Stream | None = None
    _switches_ns: list[int] = field(default_factory=list)

    @property
    def loss(self) -> float:
        """The part of the packets that never came, 0..1."""
        sent = self.received + self.lost
        return self.lost / sent if sent else 0.0

    def duplicate(self, now_ns: int) -> bool:
        """Whether two senders were heard in turns in the last two seconds."""
        return sum(now_ns - t <= WINDOW_NS for t in self._switches_ns) >= SWITCHES

    def note(self, seq: int, now_ns: int, skipped: int = 0) -> None:
        """A packet with this number came; `skipped` others came since the last, before it or after, not for us."""
        self.received += 1
        self._skipped += skipped
        heard = _Stream(seq, now_ns)
        if self._stream is None:
            self._stream = heard
            return
        step = (seq - self._stream.seq) % MODULO
        if step > NEAR and self._continues_other(heard):
            self._stream, self._other = heard, self._stream
            self._switches_ns = [t for t in self._switches_ns if now_ns - t <= WINDOW_NS] + [now_ns]
        elif 0 < step < FORWARD:
            if step > NEAR:
                self._other = self._stream
            self._stream = heard
            explained = min(self._skipped, step - 1)
            self._skipped -= explained
            self.lost += step - 1 - explained
        elif MODULO - NEAR > step >= FORWARD:  # not just overtaken or repeated on the way: the counter is another one
            self._stream, self._other = heard, self._stream

    def _continues_other(self, heard: _Stream) -> bool:
        other = self._other
        if other is None or heard.heard_ns - other.heard_ns >= FORGET_NS:
            return False
        return 0 < (heard.seq - other.seq) % MODULO <= NEAR

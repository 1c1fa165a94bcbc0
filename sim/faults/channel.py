"""One direction of one drone's link, as faults have it: lost, late, overtaken, twice, changed, said again."""

from collections import deque
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from formation.maths.frames import from_rotation_vector, multiply
from formation.messages import Datagram
from sim.faults.fault import Family, Fault
from wire.link_messages import AttitudeSetpoint
from wire.mavlink.codec import Codec, read_message
from wire.mavlink.framing import FrameCutter
from wire.transport.memory_bus import DelayModel

OVERTAKEN_NS = 30_000_000
AGAIN_NS = 5_000_000
"""A repeated packet comes so much after a new one: it would else be made good at once."""
REMEMBERED_NS = 3_000_000_000
"""So long ago lies what can be said again."""


class Sent(NamedTuple):
    """A datagram, and when it was first sent."""

    t_ns: int
    datagram: Datagram


class Channel:
    """A link whose datagrams keep their order unless a fault says otherwise; those just sent are remembered.

    It says what arrives when; whoever sends keeps it until then.
    """

    def __init__(self, delay: DelayModel, rng: np.random.Generator) -> None:
        self._delay = delay
        self._rng = rng
        self._last_due_ns = 0
        self._history: deque[Sent] = deque()

    def send(self, now_ns: int, datagram: Datagram, faults: Sequence[tuple[Fault, int]] = ()) -> list[tuple[int, Sent]]:
        """Send it now; what arrives of it, and when. faults: those that act on this link now, each with its onset."""
        sent = Sent(now_ns, datagram)
        self._history.append(sent)
        while self._history[0].t_ns < now_ns - REMEMBERED_NS:
            self._history.popleft()
        delay_ns = self._delay()
        if not faults:
            return [] if delay_ns is None else [self._in_order(now_ns + delay_ns, sent)]
        arriving: list[tuple[int, Sent]] = []
        for fault, _ in faults:
            if fault.family is Family.REPLAY and (old := self._sent_before(now_ns - round(fault.severity * 1e9))):
                arriving.append((now_ns + (delay_ns or 0) + AGAIN_NS, old))
        held_ns, again = 0, False
        for fault, onset_ns in faults:
            luck, tail = self._rng.random(), self._rng.standard_exponential()
            met = luck < fault.severity
            match fault.family:
                case Family.DROP if met:
                    delay_ns = None
                case Family.DELAY:
                    delay_ns = _later(delay_ns, fault.severity)
                case Family.GROWING_DELAY:
                    delay_ns = _later(delay_ns, fault.severity * (now_ns - onset_ns) * 1e-9)
                case Family.JITTER:
                    delay_ns = _later(delay_ns, fault.severity * tail)
                case Family.CORRUPT if met:
                    sent = Sent(now_ns, self._corrupted(datagram))
                case Family.ROGUE_SETPOINT:
                    sent = Sent(now_ns, Datagram(datagram.sysid, tilted(datagram.data, fault.severity)))
                case Family.REORDER if met:
                    held_ns = OVERTAKEN_NS
                case Family.DUPLICATE if met:
                    again = True
        if delay_ns is None:
            return arriving
        due_ns = now_ns + delay_ns
        arriving.append((due_ns + held_ns, sent) if held_ns else self._in_order(due_ns, sent))
        if again:
            arriving.append((due_ns + OVERTAKEN_NS, sent))
        return arriving

    def _in_order(self, due_ns: int, sent: Sent) -> tuple[int, Sent]:
        self._last_due_ns = max(due_ns, self._last_due_ns)
        return self._last_due_ns, sent

    def _sent_before(self, t_ns: int) -> Sent | None:
        """The last that was sent until then; each is said again once."""
        history, last = self._history, None
        while history and history[0].t_ns <= t_ns:
            last = history.popleft()
        return last

    def _corrupted(self, datagram: Datagram) -> Datagram:
        data = bytearray(datagram.data)
        data[int(self._rng.integers(len(data)))] ^= int(self._rng.integers(1, 256))
        return Datagram(datagram.sysid, bytes(data))


def _later(delay_ns: int | None, by_s: float) -> int | None:
    return None if delay_ns is None else delay_ns + round(by_s * 1e9)


def tilted(data: bytes, tilt_rad: float) -> bytes:
    """A datagram whose attitude targets are tilted so much farther, about the body's forward axis."""
    return b"".join(
        Codec(frame.source).encode(
            message._replace(
                q_lab_from_flu=multiply(message.q_lab_from_flu, from_rotation_vector(np.array([tilt_rad, 0.0, 0.0])))
            )
        )
        if isinstance(message := read_message(frame), AttitudeSetpoint)
        else frame.data
        for frame in FrameCutter().cut(data)
    )

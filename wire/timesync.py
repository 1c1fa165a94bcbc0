"""A drone's clock against ours: when to ask it by TIMESYNC, and what its answers say."""

from collections import deque
from dataclasses import dataclass, field

from wire.clock_offset import ClockOffset
from wire.link_messages.address import Address
from wire.link_messages.clocks import TimeSync

FAST_S, SLOW_S = 0.1, 1.0
SETTLED = 8
SLIP_LEAST, SLIP_OVER_NS = 1e-3, 2_000_000_000
"""A clock that differs by more, over at least so long, is no crystal: it slips. HISTORY: offsets that are looked at."""
HISTORY = 32


@dataclass(slots=True)
class TimeSyncClient:
    """Asks one drone for its clock, and answers when it asks for ours.

    slip: how much faster its clock runs than ours, as a share; None where it keeps our rate. One that slips, as a
    simulator's under load, is asked ten times a second, and so followed within a millisecond or two.
    """

    target: Address
    clock: ClockOffset = field(default_factory=ClockOffset)
    _answered: int = 0
    _asked_ns: int | None = None
    slip: float | None = None
    _history: deque[tuple[int, int, int]] = field(default_factory=lambda: deque(maxlen=HISTORY))

    def answers(self, message: TimeSync) -> bool:
        """Whether it answers our newest request: known by what it repeats, since PX4 leaves its target to chance."""
        return message.tc1_ns != 0 and message.ts1_ns == self._asked_ns

    @property
    def offset_ns(self) -> int | None:
        """The drone's clock minus ours, ns; None before the first answer."""
        return self.clock.offset_ns

    @property
    def round_trip_s(self) -> float:
        """Of the exchange that is believed, s; NaN before the first answer."""
        return float("nan") if self.clock.round_trip_ns is None else self.clock.round_trip_ns * 1e-9

    def due(self, now_ns: int) -> TimeSync | None:
        """A request, when it is time for one: ten a second until settled, then one."""
        every_s = FAST_S if self._answered < SETTLED or self.slip is not None else SLOW_S
        if self._asked_ns is not None and now_ns - self._asked_ns < round(every_s * 1e9):
            return None
        self._asked_ns = now_ns
        return TimeSync(tc1_ns=0, ts1_ns=now_ns, target=self.target)

    def receive(self, message: TimeSync, now_ns: int) -> TimeSync | None:
        """Take an answer in; answer a request (tc1 zero) with our own time."""
        if message.tc1_ns == 0:
            return TimeSync(tc1_ns=now_ns, ts1_ns=message.ts1_ns, target=self.target)
        if self.answers(message) and now_ns >= message.ts1_ns:
            self._answered += 1
            self.clock.exchange(message.ts1_ns, message.tc1_ns, now_ns)
            trip_ns = now_ns - message.ts1_ns
            self._history.append((now_ns, message.tc1_ns - (message.ts1_ns + now_ns) // 2, trip_ns))
            self.slip = self._find_slip()
        return None

    def _find_slip(self) -> float | None:
        """The rate between the oldest and the newest exchange, if it is beyond doubt and was one all the time."""
        (first_ns, first, doubt), (last_ns, last, doubt_too) = self._history[0], self._history[-1]
        if last_ns - first_ns < SLIP_OVER_NS:
            return None
        rate = (last - first) / (last_ns - first_ns)
        bent_ns = max(abs(offset - first - rate * (t_ns - first_ns)) for t_ns, offset, _ in self._history)
        sure_ns = abs(last - first) - (doubt + doubt_too) / 2
        if sure_ns < SLIP_LEAST * (last_ns - first_ns) or bent_ns > abs(last - first) / 4:
            return None  # it was set, once, or only seems to differ
        return rate


def slip_text(slip: float) -> str:
    """What a clock of another rate means, in words."""
    rate = "slower" if slip < 0.0 else "faster"
    return f"clock runs {100.0 * abs(slip):.1f} % {rate} than the computer's; its stamps are followed by TIMESYNC"

"""A drone's clock against ours: when to ask it by TIMESYNC, and what its answers say."""

from dataclasses import dataclass, field

from wire.clock_offset import ClockOffset
from wire.link_messages.address import Address
from wire.link_messages.clocks import TimeSync

FAST_S, SLOW_S = 0.1, 1.0
SETTLED = 8


@dataclass(slots=True)
class TimeSyncClient:
    """Asks one drone for its clock, and answers when it asks for ours."""

    target: Address
    clock: ClockOffset = field(default_factory=ClockOffset)
    _answered: int = 0
    _asked_ns: int | None = None

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
        every_s = FAST_S if self._answered < SETTLED else SLOW_S
        if self._asked_ns is not None and now_ns - self._asked_ns < round(every_s * 1e9):
            return None
        self._asked_ns = now_ns
        return TimeSync(tc1_ns=0, ts1_ns=now_ns, target=self.target)

    def receive(self, message: TimeSync, now_ns: int) -> TimeSync | None:
        """Take an answer in; answer a request (tc1 zero) with our own time."""
        if message.tc1_ns == 0:
            return TimeSync(tc1_ns=now_ns, ts1_ns=message.ts1_ns, target=self.target)
        if message.ts1_ns == self._asked_ns and now_ns >= message.ts1_ns:
            self._answered += 1
            self.clock.exchange(message.ts1_ns, message.tc1_ns, now_ns)
        return None

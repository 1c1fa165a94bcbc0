"""A drone's clock against ours, from TIMESYNC round trips."""

from collections import deque
from dataclasses import dataclass, field

from wire.link_messages.address import Address
from wire.link_messages.clocks import TimeSync

FAST_S, SLOW_S = 0.1, 1.0
SETTLED = 8


@dataclass(slots=True)
class ClockOffset:
    """The offset as the round trips of the last 16 exchanges bound it: the quickest one is believed."""

    target: Address
    _exchanges: deque[tuple[int, int]] = field(default_factory=lambda: deque(maxlen=16))
    _asked_ns: int | None = None

    @property
    def offset_ns(self) -> int | None:
        """The drone's clock minus ours, ns; None before the first answer."""
        return min(self._exchanges)[1] if self._exchanges else None

    @property
    def round_trip_s(self) -> float:
        """The quickest recent round trip, s; NaN before the first answer."""
        return min(self._exchanges)[0] * 1e-9 if self._exchanges else float("nan")

    def due(self, now_ns: int) -> TimeSync | None:
        """A request, when it is time for one: ten a second until settled, then one."""
        every_s = FAST_S if len(self._exchanges) < SETTLED else SLOW_S
        if self._asked_ns is not None and now_ns - self._asked_ns < round(every_s * 1e9):
            return None
        self._asked_ns = now_ns
        return TimeSync(tc1_ns=0, ts1_ns=now_ns, target=self.target)

    def receive(self, message: TimeSync, now_ns: int) -> TimeSync | None:
        """Take an answer in; answer a request (tc1 zero) with our own time."""
        if message.tc1_ns == 0:
            return TimeSync(tc1_ns=now_ns, ts1_ns=message.ts1_ns, target=self.target)
        if message.ts1_ns == self._asked_ns and now_ns >= message.ts1_ns:
            self._exchanges.append((now_ns - message.ts1_ns, message.tc1_ns - (message.ts1_ns + now_ns) // 2))
        return None

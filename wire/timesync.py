"""A drone's clock against ours: when to ask it by TIMESYNC, and what its answers say."""

from collections import deque
from dataclasses import dataclass, field
from itertools import pairwise

from wire.clock_offset import ClockOffset
from wire.link_messages.address import Address
from wire.link_messages.clocks import TimeSync

FAST_S, SLOW_S = 0.1, 1.0
SETTLED = 8
SLIP_STEPS, SLIP_WITHIN_NS = 5, 10_000_000_000
"""So many steps of the offset, one way, within so long are a clock that runs at another rate."""


@dataclass(slots=True)
class TimeSyncClient:
    """Asks one drone for its clock, and answers when it asks for ours.

    A clock that contradicts what was believed of it is asked ten times a second again: one that runs 1 % slow, as a
    simulator under load, is then followed within a millisecond.
    """

    target: Address
    clock: ClockOffset = field(default_factory=ClockOffset)
    _answered: int = 0
    _asked_ns: int | None = None
    _steps: deque[tuple[int, int]] = field(default_factory=lambda: deque(maxlen=SLIP_STEPS))

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

    def slip(self, now_ns: int) -> float | None:
        """How much faster their clock runs than ours, as a share; None where it keeps our rate."""
        if len(self._steps) < SLIP_STEPS or now_ns - self._steps[0][0] > SLIP_WITHIN_NS:
            return None
        offsets = [offset_ns for _, offset_ns in self._steps]
        rises = [later > earlier for earlier, later in pairwise(offsets)]
        if any(rises) != all(rises):
            return None
        return (offsets[-1] - offsets[0]) / (self._steps[-1][0] - self._steps[0][0])

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
        if self.answers(message) and now_ns >= message.ts1_ns:
            self._answered += 1
            before = self.clock.relearned
            self.clock.exchange(message.ts1_ns, message.tc1_ns, now_ns)
            if self.clock.relearned != before and self.clock.offset_ns is not None:
                self._answered = 0
                self._steps.append((now_ns, self.clock.offset_ns))
        return None


def slip_text(slip: float) -> str:
    """What a clock of another rate means, in words."""
    rate = "slower" if slip < 0.0 else "faster"
    return f"clock runs {100.0 * abs(slip):.1f} % {rate} than the computer's; its stamps are followed by TIMESYNC"

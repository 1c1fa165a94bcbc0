"""The offset of another clock from ours, estimated from the exchange or message with the least delay. Pure.

The delay of an exchange bounds its offset's error. The bound grows as the clocks drift, until a newer exchange has a
smaller one. A drone's clock is asked for by MAVLink TIMESYNC (`TimeSyncClient`): when to request, what answers mean.
"""

from collections import deque
from dataclasses import dataclass, field

from wire.link_messages import Address, TimeSync

DRIFT = 100e-6
"""Largest assumed drift between two clocks, s/s."""
RESTART_NS = 1_000_000_000
_AT_ONCE = -(2**62)
_WRAP_NS = 2**32 * 1_000_000
_LAG_NS = 10_000_000_000
_STAMPED_MS = (-5.0, 2000.0)
FAST_NS, SLOW_NS = 100_000_000, 1_000_000_000
SETTLED = 8
RATE_OFFSET_MIN, RATE_OFFSET_OVER_NS = 1e-3, 2_000_000_000
"""A clock whose rate differs by this share, over at least this time, is no crystal. HISTORY: exchanges compared."""
HISTORY = 32


@dataclass(slots=True)
class LeastDelay:
    """The least delay received so far; it grows by DRIFT with its age."""

    _delay_ns: int | None = None
    _updated_ns: int = 0

    def at_ns(self, now_ns: int) -> int | None:
        """The least delay, grown until `now_ns`, ns; None before the first."""
        return None if self._delay_ns is None else self._delay_ns + round((now_ns - self._updated_ns) * DRIFT)

    def offer(self, delay_ns: int, now_ns: int) -> int:
        """Receive a delay and return the least one now: this delay, if no older one is smaller."""
        if self._delay_ns is not None:
            delay_ns = min(self._delay_ns + round((now_ns - self._updated_ns) * DRIFT), delay_ns)
        self._delay_ns, self._updated_ns = delay_ns, now_ns
        return delay_ns


@dataclass(slots=True)
class SenderClock:
    """The time on our clock at which a message was made, from its sender's stamp alone.

    The quickest message received sets the offset of the two clocks. A message that waited in a queue gets the time of
    its stamp, not of its arrival.
    """

    _stamp_ns: int = 0
    _least: LeastDelay = field(default_factory=LeastDelay)

    def made_ns(self, stamp_ns: int, now_ns: int) -> int:
        """The time on our clock; `now_ns` itself for the quickest message. A stamp that goes back is a restart."""
        lag_ns = now_ns - stamp_ns
        if stamp_ns < self._stamp_ns - RESTART_NS:
            self._least = LeastDelay()
        self._stamp_ns = stamp_ns
        return now_ns - (lag_ns - self._least.offer(lag_ns, now_ns))


@dataclass(slots=True)
class ClockOffset:
    """The offset as exchanges bound it: within half the round trip of the one that is believed.

    offset_ns: their clock minus ours. round_trip_ns: of the exchange believed. Both None before the first.
    """

    offset_ns: int | None = None
    round_trip_ns: int | None = None
    _least: LeastDelay = field(default_factory=LeastDelay)
    _stamps: SenderClock = field(default_factory=SenderClock)

    def exchange(self, sent_ns: int, theirs_ns: int, now_ns: int) -> None:
        """A request sent at `sent_ns` came back at `now_ns` with their time between the two."""
        trip_ns, offset_ns = now_ns - sent_ns, theirs_ns - (sent_ns + now_ns) // 2
        if trip_ns < 0:
            return
        if self._is_inconsistent(offset_ns, trip_ns, now_ns):
            self._least = LeastDelay()
        if self._least.offer(trip_ns, now_ns) == trip_ns:
            self.offset_ns, self.round_trip_ns = offset_ns, trip_ns

    def to_ours_ns(self, theirs_ns: int) -> int | None:
        """Our time at a time of theirs."""
        return None if self.offset_ns is None else theirs_ns - self.offset_ns

    def made_ns(self, stamp_ns: int, now_ns: int) -> int:
        """When a message with that stamp was made, our clock, not after now; by the quickest message ever heard, until
        there was an exchange: a slow clock and a growing queue look the same to stamps alone."""
        by_stamps_ns = self._stamps.made_ns(stamp_ns, now_ns)
        return by_stamps_ns if self.offset_ns is None else min(stamp_ns - self.offset_ns, now_ns)

    def since_ns(self, stamp_ns: int, now_ns: int) -> int | None:
        """Time since a stamp of their clock, whatever it is; None before the first exchange.

        Stamps of 32-bit milliseconds wrap around after 49.7 days; the result takes it into account.
        """
        if self.offset_ns is None:
            return None
        return (now_ns + self.offset_ns - stamp_ns + _WRAP_NS // 2) % _WRAP_NS - _WRAP_NS // 2

    def lag_ns(self, stamp_ns: int, now_ns: int) -> int | None:
        """Time since such a stamp; None beyond 10 s: no link lags so far, the stamp is of another clock."""
        since_ns = self.since_ns(stamp_ns, now_ns)
        return None if since_ns is None or abs(since_ns) > _LAG_NS else since_ns

    def since_ms(self, stamp_ms: int, now_ns: int) -> float | None:
        """The same of a millisecond stamp, ms."""
        since_ns = self.since_ns(stamp_ms * 1_000_000, now_ns)
        return None if since_ns is None else since_ns * 1e-6

    def age_ms(self, stamp_ms: int, now_ns: int) -> float | None:
        """Age of a 32-bit millisecond stamp of their clock; None where it is no such stamp."""
        age = self.since_ms(stamp_ms, now_ns)
        return None if age is None or not _STAMPED_MS[0] < age < _STAMPED_MS[1] else age

    def _is_inconsistent(self, offset_ns: int, trip_ns: int, now_ns: int) -> bool:
        """Whether no single offset fits this exchange and the best one: the other clock was set or restarted."""
        least_ns = self._least.at_ns(now_ns)
        if self.offset_ns is None or least_ns is None:
            return False
        return 2 * abs(offset_ns - self.offset_ns) > trip_ns + least_ns + 2


@dataclass(slots=True)
class TimeSyncClient:
    """Requests one drone's time, and answers its requests for ours.

    rate_offset: the frequency offset of its clock from ours, as a share; None where it is below RATE_OFFSET_MIN. With
    one, as of a simulator under load, it requests ten times a second and follows the clock within 2 ms.
    """

    target: Address
    clock: ClockOffset = field(default_factory=ClockOffset)
    next_ns: int = _AT_ONCE
    """Before that `due` has no request."""
    _answered: int = 0
    _asked_ns: deque[int] = field(default_factory=lambda: deque(maxlen=HISTORY))
    rate_offset: float | None = None
    _history: deque[tuple[int, int, int]] = field(default_factory=lambda: deque(maxlen=HISTORY))

    def answers(self, message: TimeSync) -> bool:
        """Whether it answers a request of ours: known by what it repeats, since PX4 leaves its target to chance.

        An answer may be older than the newest request, where it waited in a queue: that is when its clock is wanted.
        """
        return message.tc1_ns != 0 and message.ts1_ns in self._asked_ns

    @property
    def offset_ns(self) -> int | None:
        """The drone's clock minus ours, ns; None before the first answer."""
        return self.clock.offset_ns

    @property
    def round_trip_s(self) -> float:
        """Round trip of the exchange that is believed, s; NaN before the first answer."""
        return float("nan") if self.clock.round_trip_ns is None else self.clock.round_trip_ns * 1e-9

    def due(self, now_ns: int) -> TimeSync | None:
        """A request, when it is time for one: ten a second until settled, then one."""
        every_ns = FAST_NS if self._answered < SETTLED or self.rate_offset is not None else SLOW_NS
        if self._asked_ns and now_ns - self._asked_ns[-1] < every_ns:
            self.next_ns = self._asked_ns[-1] + every_ns
            return None
        self._asked_ns.append(now_ns)
        self.next_ns = now_ns + FAST_NS
        return TimeSync(tc1_ns=0, ts1_ns=now_ns, target=self.target)

    def receive(self, message: TimeSync, now_ns: int) -> TimeSync | None:
        """Receive an answer; answer a request (tc1 zero) with our own time."""
        if message.tc1_ns == 0:
            return TimeSync(tc1_ns=now_ns, ts1_ns=message.ts1_ns, target=self.target)
        if self.answers(message) and now_ns >= message.ts1_ns:
            self._answered += 1
            self.next_ns = _AT_ONCE
            self.clock.exchange(message.ts1_ns, message.tc1_ns, now_ns)
            trip_ns = now_ns - message.ts1_ns
            self._history.append((now_ns, message.tc1_ns - (message.ts1_ns + now_ns) // 2, trip_ns))
            self.rate_offset = self._detect_rate_offset()
        return None

    def _detect_rate_offset(self) -> float | None:
        """The frequency offset between the oldest and newest exchange; None where it is uncertain or not constant."""
        (first_ns, first, doubt), (last_ns, last, doubt_too) = self._history[0], self._history[-1]
        if last_ns - first_ns < RATE_OFFSET_OVER_NS:
            return None
        rate = (last - first) / (last_ns - first_ns)
        bent_ns = max(abs(offset - first - rate * (t_ns - first_ns)) for t_ns, offset, _ in self._history)
        sure_ns = abs(last - first) - (doubt + doubt_too) / 2
        if sure_ns < RATE_OFFSET_MIN * (last_ns - first_ns) or bent_ns > abs(last - first) / 4:
            return None  # the clock was set once, or the difference is within the doubt
        return rate


def rate_offset_text(rate_offset: float) -> str:
    """A clock's frequency offset, as a text for the operator."""
    rate = "slower" if rate_offset < 0.0 else "faster"
    return (
        f"clock runs {100.0 * abs(rate_offset):.1f} % {rate} than the computer's; its stamps are followed by TIMESYNC"
    )

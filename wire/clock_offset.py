"""Another clock against ours: the exchange, or the message, that was delayed least is believed. Pure.

A delay is the doubt about what it tells. As two clocks part, the doubt about what is believed grows, until a newer
one is at least as good.
"""

from dataclasses import dataclass, field

DRIFT = 100e-6
"""How fast two clocks may part."""
RESTART_NS = 1_000_000_000
_STAMPED_MS = (-5.0, 2000.0)


@dataclass(slots=True)
class LeastDelay:
    """The least delay ever heard of, growing by DRIFT as it ages."""

    _delay_ns: int | None = None
    _heard_ns: int = 0

    def at_ns(self, now_ns: int) -> int | None:
        """What it has grown to; None before the first."""
        return None if self._delay_ns is None else self._delay_ns + round((now_ns - self._heard_ns) * DRIFT)

    def offer(self, delay_ns: int, now_ns: int) -> int:
        """Take a delay in; the least one now, which is this one where it is to be believed."""
        grown_ns = self.at_ns(now_ns)
        least_ns = delay_ns if grown_ns is None else min(grown_ns, delay_ns)
        self._delay_ns, self._heard_ns = least_ns, now_ns
        return least_ns


@dataclass(slots=True)
class ClockOffset:
    """The offset as exchanges bound it: within half the round trip of the one that is believed.

    offset_ns: their clock minus ours. round_trip_ns: of the exchange believed. Both None before the first.
    """

    offset_ns: int | None = None
    round_trip_ns: int | None = None
    _least: LeastDelay = field(default_factory=LeastDelay)

    def exchange(self, sent_ns: int, theirs_ns: int, now_ns: int) -> None:
        """A request sent at `sent_ns` came back at `now_ns` with their time between the two."""
        trip_ns, offset_ns = now_ns - sent_ns, theirs_ns - (sent_ns + now_ns) // 2
        if trip_ns < 0:
            return
        if self._contradicts(offset_ns, trip_ns, now_ns):
            self._least = LeastDelay()
        if self._least.offer(trip_ns, now_ns) == trip_ns:
            self.offset_ns, self.round_trip_ns = offset_ns, trip_ns

    def to_ours_ns(self, theirs_ns: int) -> int | None:
        """Our time at a time of theirs."""
        return None if self.offset_ns is None else theirs_ns - self.offset_ns

    def since_ms(self, stamp_ms: int, now_ns: int) -> float | None:
        """Time since a 32-bit millisecond stamp of their clock, whatever it is; None before the first exchange."""
        if self.offset_ns is None:
            return None
        their_ms = (now_ns + self.offset_ns) * 1e-6
        return (their_ms - stamp_ms + 2.0**31) % 2.0**32 - 2.0**31

    def age_ms(self, stamp_ms: int, now_ns: int) -> float | None:
        """Age of a 32-bit millisecond stamp of their clock; None where it is no such stamp."""
        age = self.since_ms(stamp_ms, now_ns)
        return None if age is None or not _STAMPED_MS[0] < age < _STAMPED_MS[1] else age

    def _contradicts(self, offset_ns: int, trip_ns: int, now_ns: int) -> bool:
        """Whether no offset explains both this exchange and the one believed: their clock was set, or started anew."""
        least_ns = self._least.at_ns(now_ns)
        if self.offset_ns is None or least_ns is None:
            return False
        return 2 * abs(offset_ns - self.offset_ns) > trip_ns + least_ns + 2


@dataclass(slots=True)
class SenderClock:
    """When a message was made, on our clock, from its sender's stamp alone.

    The difference of two clocks is what the quickest message ever heard sets it to: what waited in a queue, here or on
    the way, is told by its stamp, not by its arrival.
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

"""The ground's clock, as TIMESYNC tells it: from the exchanges that took least."""

_SLACK_NS = 500_000
_FORGET = 1.1


class GroundClock:
    """Offset of the ground's clock to this agent's time since boot; unknown until the first exchange."""

    def __init__(self) -> None:
        self._best_ns = float("inf")
        self._offset_ns: int | None = None

    def exchange(self, sent_ns: int, theirs_ns: int, now_ns: int) -> None:
        """A request sent at `sent_ns` came back at `now_ns` with the ground's time between the two."""
        trip_ns = now_ns - sent_ns
        if trip_ns < 0:
            return
        if trip_ns <= self._best_ns + _SLACK_NS:
            self._offset_ns = theirs_ns - (sent_ns + now_ns) // 2
        self._best_ns = min(trip_ns, self._best_ns * _FORGET)

    def to_own_ns(self, ground_ns: int) -> int | None:
        """This agent's time since boot at a time of the ground's clock."""
        return None if self._offset_ns is None else ground_ns - self._offset_ns

    def age_ms(self, stamp_ms: int, now_ns: int) -> float | None:
        """Age of a 32-bit millisecond stamp of the ground's clock; None where it is no such stamp."""
        if self._offset_ns is None:
            return None
        ground_ms = (now_ns + self._offset_ns) * 1e-6
        age = (ground_ms - stamp_ms + 2.0**31) % 2.0**32 - 2.0**31
        return age if -5.0 < age < 2000.0 else None

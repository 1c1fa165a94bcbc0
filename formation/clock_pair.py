"""What ties the monotonic clock, which control and logs run on, to the date. Without arrays: the clock gives it."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class ClockPair:
    """One moment on two clocks, ns: the monotonic one of all stamps, and the wall clock since 1970, UTC."""

    monotonic_ns: int
    unix_ns: int

    @property
    def ahead_ns(self) -> int:
        """What is added to a monotonic stamp for the date; steps of the wall clock afterwards do not alter it."""
        return self.unix_ns - self.monotonic_ns


SIMULATED = ClockPair(0, 946_684_800_000_000_000)
"""Simulated time begins on 2000-01-01 at 00:00 UTC, so that a scenario and a seed give the same log on every day."""

"""When a message was made, on our clock, from its sender's stamp alone. Pure."""

from dataclasses import dataclass

DRIFT = 100e-6
"""How fast two clocks may part."""
RESTART_NS = 1_000_000_000


@dataclass(slots=True)
class SenderClock:
    """The difference of two clocks, as the quickest message ever heard sets it.

    What waited in a queue, here or on the way, is told by its stamp, not by its arrival.
    """

    least_ns: int | None = None
    stamp_ns: int = 0
    heard_ns: int = 0

    def made_ns(self, stamp_ns: int, now_ns: int) -> int:
        """The time on our clock; `now_ns` itself for the quickest message. A stamp that goes back is a restart."""
        lag_ns = now_ns - stamp_ns
        if self.least_ns is None or stamp_ns < self.stamp_ns - RESTART_NS:
            self.least_ns = lag_ns
        else:
            drift_ns = round((now_ns - self.heard_ns) * DRIFT)
            self.least_ns = min(self.least_ns + drift_ns, lag_ns)
        self.stamp_ns, self.heard_ns = stamp_ns, now_ns
        return now_ns - (lag_ns - self.least_ns)

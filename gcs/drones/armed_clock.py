"""Since when a drone has been armed, as its heartbeats and its answers tell: what its own time-out counts."""

from dataclasses import dataclass


@dataclass(slots=True)
class ArmedClock:
    """A heartbeat tells of arming late; the answer to our command, where there was one, tells when. Never too late.

    since_ns: None while disarmed. lasted_s: for how long it was armed the last time.
    """

    since_ns: int | None = None
    lasted_s: float = 0.0
    _disarmed_ns: int | None = None
    _accepted_ns: int | None = None

    def accept(self, now_ns: int) -> None:
        """The drone has taken a command to arm, or to disarm."""
        if self.since_ns is None and self._accepted_ns is None:
            self._accepted_ns = now_ns

    def hear(self, armed: bool, now_ns: int) -> None:
        """A heartbeat came."""
        if armed and self.since_ns is None:
            known = [t_ns for t_ns in (self._disarmed_ns, self._accepted_ns) if t_ns is not None]
            self.since_ns = max(known, default=now_ns)
        if not armed:
            if self.since_ns is not None:
                self.lasted_s = (now_ns - self.since_ns) * 1e-9
            self.since_ns, self._accepted_ns, self._disarmed_ns = None, None, now_ns

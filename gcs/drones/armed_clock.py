"""Since when a drone has been armed, by its heartbeats and acknowledgements: the start of its own disarm time-out."""

from dataclasses import dataclass


@dataclass(slots=True)
class ArmedClock:
    """A heartbeat reports arming late; the acknowledgement of our command gives the time. The result is never too late.

    since_ns: None while disarmed. lasted_s: for how long it was armed the last time.
    """

    since_ns: int | None = None
    lasted_s: float = 0.0
    _disarmed_ns: int | None = None
    _accepted_ns: int | None = None

    def accept(self, now_ns: int) -> None:
        """The drone has accepted a command to arm, or to disarm."""
        if self.since_ns is None and self._accepted_ns is None:
            self._accepted_ns = now_ns

    def receive_heartbeat(self, armed: bool, now_ns: int) -> None:
        """Receive a heartbeat."""
        if armed and self.since_ns is None:
            known = [t_ns for t_ns in (self._disarmed_ns, self._accepted_ns) if t_ns is not None]
            self.since_ns = max(known, default=now_ns)
        if not armed:
            if self.since_ns is not None:
                self.lasted_s = (now_ns - self.since_ns) * 1e-9
            self.since_ns, self._accepted_ns, self._disarmed_ns = None, None, now_ns

"""A simulator that cannot keep up: what it shows is no flight, and nothing that flies in it is to blame."""

from dataclasses import dataclass

EXIT_CODE = 3
"""Of every simulator's process that ends for this."""
LATE_NS = 100_000_000
"""The shortest time-out that a late simulator would trip: a drone levels without a setpoint for so long."""


class StarvedError(RuntimeError):
    """A simulator was too late for its own next event: the machine gives it too little time."""


@dataclass(frozen=True, slots=True)
class Punctuality:
    """Holds a simulator against its own schedule."""

    who: str
    what: str

    def check(self, due_ns: int, now_ns: int) -> None:
        """StarvedError where what was due comes later than LATE_NS."""
        if now_ns - due_ns > LATE_NS:
            late_ms = (now_ns - due_ns) * 1e-6
            raise StarvedError(f"{self.who} is starved: {self.what} {late_ms:.0f} ms late, the machine is too slow")

"""A camera system's own clock: it starts with the server, and runs as fast as oscillators do."""

from dataclasses import dataclass

PARTS_PER_MILLION = 20e-6


@dataclass(slots=True)
class ServerClock:
    """Moved against ours. rate: its seconds in one of ours."""

    rate: float = 1.0 + PARTS_PER_MILLION
    started_ns: int | None = None

    def at_ns(self, ours_ns: int) -> int:
        """What it shows at a time of ours; 1 s when it is asked first, so that nothing lies before its start."""
        if self.started_ns is None:
            self.started_ns = ours_ns
        return 1_000_000_000 + round((ours_ns - self.started_ns) * self.rate)

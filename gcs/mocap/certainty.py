"""What is told, and so recorded in every flight's log, of how well exposures are known. Pure."""

from formation.messages import Event, Severity
from gcs.mocap.sources.source import SourceStatus

EVERY_NS = 10_000_000_000
CHANGED = 2.0
POOR_S = 2e-3
"""More than this turns a drone's fastest turns into degrees."""


class Certainty:
    """Says how certain capture times are: when it is first known, and when it has changed by half or twice."""

    def __init__(self) -> None:
        self._told_s: float | None = None
        self._told_ns = 0

    def events(self, status: SourceStatus, now_ns: int) -> tuple[Event, ...]:
        """What there is to tell now; every 10 s at most."""
        found_s = status.uncertainty_s
        if found_s is None or status.latency_s is None or not self._is_news(max(found_s, 1e-5), now_ns):
            return ()
        self._told_s, self._told_ns = max(found_s, 1e-5), now_ns
        constant = "" if status.constant_told else ", apart from the constant that latency_s says"
        text = f"capture times are certain to {1e3 * found_s:.2f} ms{constant}; latency {1e3 * status.latency_s:.1f} ms"
        return (Event(Severity.WARNING if found_s > POOR_S else Severity.INFO, "mocap", text),)

    def _is_news(self, found_s: float, now_ns: int) -> bool:
        if self._told_s is None:
            return True
        ratio = found_s / self._told_s
        return now_ns - self._told_ns >= EVERY_NS and not 1.0 / CHANGED < ratio < CHANGED

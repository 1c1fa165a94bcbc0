"""Events about the uncertainty of capture times, for the operator and the flight log. Pure."""

from formation.messages import Event, Severity
from mocap.sources.source import SourceStatus

EVERY_NS = 10_000_000_000
CHANGED = 2.0
POOR_S = 2e-3
"""More than this turns a drone's fastest turns into degrees."""


class Certainty:
    """Reports the capture times' uncertainty when it is first known, and when it has halved or doubled."""

    def __init__(self) -> None:
        self._reported_s: float | None = None
        self._reported_ns = 0

    def events(self, status: SourceStatus, now_ns: int) -> tuple[Event, ...]:
        """The event that is due now, at most one every 10 s; empty otherwise."""
        found_s = status.uncertainty_s
        if found_s is None or status.latency_s is None or not self._is_news(max(found_s, 1e-5), now_ns):
            return ()
        self._reported_s, self._reported_ns = max(found_s, 1e-5), now_ns
        constant = "" if status.latency_measured else ", apart from the constant that latency_s says"
        text = f"capture times are certain to {1e3 * found_s:.2f} ms{constant}; latency {1e3 * status.latency_s:.1f} ms"
        return (Event(Severity.WARNING if found_s > POOR_S else Severity.INFO, "mocap", text),)

    def _is_news(self, found_s: float, now_ns: int) -> bool:
        if self._reported_s is None:
            return True
        ratio = found_s / self._reported_s
        return now_ns - self._reported_ns >= EVERY_NS and not 1.0 / CHANGED < ratio < CHANGED

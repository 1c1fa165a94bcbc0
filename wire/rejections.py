"""Rejected inputs from outside: counted, and reported at most once a second for each source. Pure.

Sources and reasons come in floods and under invented names, so both are bounded here and nothing else needs to be.
"""

from dataclasses import dataclass, field

from formation.messages import Event, EventCode, Severity

REPORT_PERIOD_NS = 1_000_000_000
SOURCES, REASONS = 16, 4
OTHERS, OTHER_REASONS = "others", "other reasons"


@dataclass(slots=True)
class _Source:
    """One source: when it was last reported, and how many inputs were rejected since, by reason."""

    reported_ns: int | None = None
    reasons: dict[str, int] = field(default_factory=dict)

    def due_ns(self) -> int | None:
        """When to report it next; 0 for the first report, None while there is nothing to report."""
        if not self.reasons:
            return None
        return 0 if self.reported_ns is None else self.reported_ns + REPORT_PERIOD_NS


class RejectionLog:
    """Counts rejected inputs and reports them by source: the first at once, later ones once a second.

    The 17th source at a time is reported as `OTHERS`, so that invented senders fill neither memory nor terminal.
    """

    def __init__(self, verb: str = "refused") -> None:
        """verb: the first word of each report, "refused" or, say, "bounded"."""
        self.count = 0
        """All rejected inputs so far."""
        self.has_pending = False
        """Whether `due` may have something to report, now or later."""
        self._verb = verb
        self._sources: dict[str, _Source] = {}

    def note(self, source: str, reason: str, now_ns: int, count: int = 1) -> None:
        """Count rejected inputs of `source`; `reason` is one of a few fixed texts."""
        self.count += count
        self.has_pending = True
        known = self._sources.get(source) or self._admit(source, now_ns)
        reasons = known.reasons
        if reason not in reasons and len(reasons) >= REASONS:
            reason = OTHER_REASONS
        reasons[reason] = reasons.get(reason, 0) + count

    def due(self, now_ns: int) -> tuple[Event, ...]:
        """The reports due now: one warning a source, none where its last report is less than a second old."""
        events = []
        self.has_pending = False
        for name, source in self._sources.items():
            due_ns = source.due_ns()
            if due_ns is not None and now_ns >= due_ns:
                events.append(
                    Event(Severity.WARNING, name, _words(self._verb, source.reasons), code=EventCode.INPUT_REJECTED)
                )
                source.reported_ns, source.reasons = now_ns, {}
            elif due_ns is not None:
                self.has_pending = True
        return tuple(events)

    def _admit(self, source: str, now_ns: int) -> _Source:
        """Add a source; where all SOURCES are in use, replace the quiet ones, or else count it as `OTHERS`."""
        if len(self._sources) >= SOURCES:
            quiet = [
                name
                for name, known in self._sources.items()
                if not known.reasons
                and known.reported_ns is not None
                and now_ns - known.reported_ns >= REPORT_PERIOD_NS
            ]
            for name in quiet:
                del self._sources[name]
            if not quiet:
                source = OTHERS
        return self._sources.setdefault(source, _Source())


def _words(verb: str, reasons: dict[str, int]) -> str:
    """ "refused: 640 x not MAVLink, 2 x larger than 2048 bytes"."""
    return f"{verb}: " + ", ".join(f"{count} x {reason}" for reason, count in reasons.items())

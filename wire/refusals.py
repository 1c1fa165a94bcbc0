"""What was refused from outside: all of it counted, each source told of at most once a second. Pure.

Sources and reasons come in floods and under invented names, so both are bounded here and nothing else needs to be.
"""

from dataclasses import dataclass, field

from formation.messages import Event, Severity

TELL_NS = 1_000_000_000
SOURCES, REASONS = 16, 4
OTHERS, OTHER_REASONS = "others", "other reasons"


@dataclass(slots=True)
class _Source:
    """One source: when it was last told of, and what was refused since, by reason."""

    told_ns: int | None = None
    reasons: dict[str, int] = field(default_factory=dict)

    def due_ns(self) -> int | None:
        """When to tell; None while there is nothing to tell, zero for the first time."""
        if not self.reasons:
            return None
        return 0 if self.told_ns is None else self.told_ns + TELL_NS


class Refusals:
    """Counts refusals and puts them in words: the first at once, what follows it once a second, by source.

    The 17th source at a time is told under `OTHERS`, so that invented senders fill neither memory nor terminal.
    """

    def __init__(self, told: str = "refused") -> None:
        """told: the word for what became of it."""
        self.count = 0
        """All that was ever refused."""
        self._told = told
        self._sources: dict[str, _Source] = {}

    def note(self, source: str, reason: str, now_ns: int, count: int = 1) -> None:
        """Something of `source` was refused; `reason` is one of few, in words of ours."""
        self.count += count
        known = self._sources.get(source) or self._admit(source, now_ns)
        reasons = known.reasons
        if reason not in reasons and len(reasons) >= REASONS:
            reason = OTHER_REASONS
        reasons[reason] = reasons.get(reason, 0) + count

    def due(self, now_ns: int) -> tuple[Event, ...]:
        """What there is to tell now: one warning a source, none for what was told of less than a second ago."""
        events = []
        for name, source in self._sources.items():
            due_ns = source.due_ns()
            if due_ns is not None and now_ns >= due_ns:
                events.append(Event(Severity.WARNING, name, _words(self._told, source.reasons)))
                source.told_ns, source.reasons = now_ns, {}
        return tuple(events)

    def _admit(self, source: str, now_ns: int) -> _Source:
        """A place for a new source: that of one that has gone quiet if all are taken, else with the others."""
        if len(self._sources) >= SOURCES:
            quiet = [
                name
                for name, known in self._sources.items()
                if not known.reasons and known.told_ns is not None and now_ns - known.told_ns >= TELL_NS
            ]
            for name in quiet:
                del self._sources[name]
            if not quiet:
                source = OTHERS
        return self._sources.setdefault(source, _Source())


def _words(told: str, reasons: dict[str, int]) -> str:
    """ "refused: 640 x not MAVLink, 2 x larger than 2048 bytes"."""
    return f"{told}: " + ", ".join(f"{count} x {reason}" for reason, count in reasons.items())

"""Repeated events, folded into one line each: text only, no markup."""

import re
from dataclasses import dataclass

from analysis.series import Series
from formation.messages import Event, Severity

PAUSE_S = 5.0
"""A pause longer than this begins a new line."""
_NUMBER = re.compile(r"\d+(?:\.\d+)?")


@dataclass(slots=True)
class FoldedEvent:
    """One event, or several of the same words, whatever their numbers, from first_s to last_s."""

    event: Event
    first_s: float
    last_s: float
    count: int = 1

    @property
    def time(self) -> str:
        """`20.95 s`, `20.95-21.47 s`."""
        span = f"{self.first_s:.2f}"
        return f"{span} s" if self.count == 1 else f"{span}-{self.last_s:.2f} s"

    @property
    def text(self) -> str:
        """`23 x setpoints stale`; where numbers in the text differ, the first ones."""
        return self.event.text if self.count == 1 else f"{self.count} x {self.event.text}"


def folded(events: Series[Event], least: Severity = Severity.DEBUG) -> list[FoldedEvent]:
    """The events at least that severe, in order of their first time."""
    lines: list[FoldedEvent] = []
    newest: dict[tuple[Severity, str, str], FoldedEvent] = {}
    for t_s, event in zip(events.t_s.tolist(), events.messages, strict=True):
        if event.severity > least:
            continue
        key = (event.severity, event.source, _NUMBER.sub("#", event.text))
        line = newest.get(key)
        if line is not None and t_s - line.last_s <= PAUSE_S:
            line.last_s, line.count = t_s, line.count + 1
        else:
            newest[key] = FoldedEvent(event, t_s, t_s)
            lines.append(newest[key])
    return lines

"""Alarms: what was told with a warning or worse, until somebody acknowledges it. Pure; wall-clock times in seconds."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from formation.messages import Event, Severity

LOUD = Severity.ERROR
"""What is as severe as this, or more, is heard until it is acknowledged."""
MOST = 100
HEARD_MOST = 1000
"""Events remembered as heard: many times what a state repeats."""


@dataclass(frozen=True, slots=True)
class Alarm:
    """One alarm: when, how severe, whose, in words; times: how often it came since `unix_s`."""

    unix_s: float
    severity: Severity
    source: str
    text: str
    times: int = 1


@dataclass(slots=True)
class AlarmBook:
    """Keeps alarms in order of their first coming; the same words again raise a count. Bounded: the oldest is lost."""

    _kept: dict[tuple[str, str], Alarm] = field(default_factory=dict)
    _heard: dict[tuple[int, int, str], None] = field(default_factory=dict)
    """The ground's events that were taken in, by its epoch, their number and text: a false number hides no other."""
    _latest: list[Alarm] = field(default_factory=list)

    def hear_ground(self, state: Mapping[str, Any]) -> None:
        """Take in the events of the ground's state that are new; a ground started anew begins to count anew."""
        for event in state["events"]:
            key = int(state["epoch"]), int(event["id"]), str(event["text"])
            if key in self._heard:
                continue
            self._heard[key] = None
            severity = Severity[str(event["severity"])]
            self.hear(Event(severity, str(event["source"]), str(event["text"])), float(event["unix_s"]))
        while len(self._heard) > HEARD_MOST:
            del self._heard[next(iter(self._heard))]

    def hear(self, event: Event, unix_s: float) -> None:
        """Take an event in."""
        self._latest = [*self._latest[-7:], Alarm(unix_s, event.severity, event.source, event.text)]
        if event.severity > Severity.WARNING:
            return
        key = (event.source, event.text)
        before = self._kept.pop(key, None)
        times = 1 if before is None else before.times + 1
        self._kept[key] = Alarm(unix_s, event.severity, event.source, event.text, times)
        while len(self._kept) > MOST:
            del self._kept[next(iter(self._kept))]

    def acknowledge(self) -> None:
        """Somebody has read them all."""
        self._kept.clear()

    @property
    def open(self) -> tuple[Alarm, ...]:
        """Those that nobody has acknowledged: the severest first, of these the newest."""
        return tuple(sorted(self._kept.values(), key=lambda alarm: (alarm.severity, -alarm.unix_s)))

    @property
    def latest(self) -> tuple[Alarm, ...]:
        """The newest things told, of whatever severity, the newest first."""
        return tuple(reversed(self._latest))

    @property
    def loud(self) -> bool:
        """Whether there is something to be heard."""
        return any(alarm.severity <= LOUD for alarm in self._kept.values())


def severities(alarms: Iterable[Alarm]) -> str:
    """How many of which kind, in words."""
    counts: dict[str, int] = {}
    for alarm in alarms:
        counts[alarm.severity.name.lower()] = counts.get(alarm.severity.name.lower(), 0) + 1
    return ", ".join(f"{count} {name}" for name, count in counts.items())

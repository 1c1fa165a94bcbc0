"""Alarms: events of severity WARNING or worse, until they are acknowledged and over; and the newest events. Pure.

Times are wall-clock times, s. `AlarmBook` and `EventMemory` are the ground's, `ShownAlarms` a viewer's.
"""

from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass, field, replace

from formation.messages import Event, EventCode, Severity
from wire.ground_state import Alarm, GroundState, PublishedEvent

LOUD = Severity.ERROR
"""An alarm as severe as this, or more, is heard until it is acknowledged."""
MOST = 100
ACKNOWLEDGED = Event(Severity.NOTICE, "operator", "alarms acknowledged", code=EventCode.ACKNOWLEDGED)
"""The ground's event when an operator has acknowledged every alarm."""
LATEST = 8
_STYLES = {Severity.CRITICAL: "bold white on red", Severity.ERROR: "bold red", Severity.WARNING: "yellow"}


@dataclass(slots=True)
class AlarmBook:
    """Keeps alarms in order of their first coming; the same condition again raises a count.

    An alarm goes when it is acknowledged and its condition has ended, in whatever order. Bounded: of the least severe
    the oldest is lost.
    """

    _alarms: dict[tuple[str, str, str], Alarm] = field(default_factory=dict)

    def receive(self, event: Event, unix_s: float) -> None:
        """Receive an event at a wall-clock time, `ACKNOWLEDGED` and the end of a condition included."""
        if event.code == EventCode.ACKNOWLEDGED:
            self.acknowledge()
        before = self._alarms.get(event.key)
        if event.ends and before is not None:
            self._store(replace(before, goes_on=False, cleared=True))
        if event.severity > Severity.WARNING:
            return
        self._alarms.pop(event.key, None)
        times = 1 if before is None else before.times + 1
        code, subject = event.code, event.subject
        self._store(Alarm(unix_s, event.severity, event.source, event.text, code, subject, times, event.lasts))

    def add(self, alarm: Alarm) -> None:
        """Add an alarm of a ground that is gone: its end will not be reported."""
        self._store(replace(alarm, goes_on=False))

    def acknowledge(self) -> None:
        """Somebody has read them all; those whose conditions go on stay."""
        for alarm in tuple(self._alarms.values()):
            self._store(replace(alarm, acknowledged=True))

    @property
    def open(self) -> tuple[Alarm, ...]:
        """Those that are not both acknowledged and over, as `ordered` has it."""
        return ordered(self._alarms.values())

    def _store(self, alarm: Alarm) -> None:
        if alarm.acknowledged and not alarm.goes_on:
            self._alarms.pop(alarm.key, None)
            return
        self._alarms[alarm.key] = alarm
        while len(self._alarms) > MOST:
            del self._alarms[max(self._alarms, key=lambda entry: self._alarms[entry].severity)]


class EventMemory:
    """The alarms, and the newest events: numbered from 1 on, with their wall-clock times, debugging words left out."""

    def __init__(self) -> None:
        self._count = 0
        self._events: deque[PublishedEvent] = deque(maxlen=40)
        self.alarms = AlarmBook()

    def note(self, event: Event, unix_us: int) -> None:
        """Keep it."""
        if event.severity is Severity.DEBUG:
            return
        unix_s = round(unix_us * 1e-6, 2)
        self.alarms.receive(event, unix_s)
        self._count += 1
        published = PublishedEvent(
            self._count, unix_s, event.severity, event.source, event.text, event.code, event.subject
        )
        self._events.append(published)

    @property
    def newest(self) -> tuple[PublishedEvent, ...]:
        """The newest events, in order."""
        return tuple(self._events)


def ordered(alarms: Iterable[Alarm]) -> tuple[Alarm, ...]:
    """Those nobody has acknowledged before the others, the newest first."""
    return tuple(sorted(alarms, key=lambda alarm: (alarm.acknowledged, -alarm.unix_s)))


def folded(alarms: Iterable[Alarm], most: int = MOST) -> tuple[tuple[Alarm, ...], str]:
    """The alarms that are shown line by line, in order, and a text about the others.

    Cleared ones are counted alone; of more than `most` others, the severest and newest are shown.
    """
    every = ordered(alarms)
    standing = [alarm for alarm in every if not alarm.cleared]
    first = sorted(standing, key=lambda alarm: (alarm.acknowledged, alarm.level))[:most]
    more, cleared = len(standing) - len(first), len(every) - len(standing)
    counts = (f"{count} {name}" for count, name in ((more, "more"), (cleared, "cleared")) if count)
    return ordered(first), ", ".join(counts)


def style(alarm: Alarm) -> str:
    """An alarm's style in a terminal."""
    return "dim" if alarm.acknowledged else _STYLES[alarm.level]


class ShownAlarms:
    """The ground keeps its alarms; those of a ground that is gone stay here until they are acknowledged."""

    def __init__(self) -> None:
        self._own = AlarmBook()
        self._ground: tuple[Alarm, ...] = ()
        self._session: int | None = None
        self._ground_events: tuple[Alarm, ...] = ()
        self._own_events: list[Alarm] = []

    def receive_ground(self, state: GroundState) -> None:
        """Receive the alarms and the newest events of the ground's state."""
        if state.ground_session != self._session:
            self.retain_ground_alarms()
        self._session, self._ground = state.ground_session, state.alarms[:MOST]
        self._ground_events = tuple(
            Alarm(event.unix_s, event.severity, event.source, event.text, event.code, event.subject)
            for event in state.events[-LATEST:]
        )

    def retain_ground_alarms(self) -> None:
        """Keep the unacknowledged alarms of a ground that is gone."""
        for alarm in self._ground:
            if not alarm.acknowledged:
                self._own.add(alarm)
        self._ground = ()

    def receive(self, event: Event, unix_s: float) -> None:
        """Receive an event of this process."""
        self._own.receive(event, unix_s)
        self._own_events = [*self._own_events[1 - LATEST :], Alarm(unix_s, event.severity, event.source, event.text)]

    def acknowledge(self) -> None:
        """Somebody has read those of this process; those of the ground are acknowledged by asking it."""
        self._own.acknowledge()

    @property
    def open(self) -> tuple[Alarm, ...]:
        """Those that are not both acknowledged and over."""
        return ordered((*self._ground, *self._own.open))

    @property
    def latest(self) -> tuple[Alarm, ...]:
        """The newest events of any severity, the newest first."""
        return tuple(sorted((*self._ground_events, *self._own_events), key=lambda alarm: -alarm.unix_s)[:LATEST])

    @property
    def loud(self) -> bool:
        """Whether there is something to be heard."""
        return any(alarm.severity <= LOUD and not alarm.acknowledged for alarm in self.open)


def severities(alarms: Iterable[Alarm]) -> str:
    """How many of which kind, in words; those that are acknowledged are counted as such."""
    counts: dict[str, int] = {}
    for alarm in alarms:
        kind = "acknowledged" if alarm.acknowledged else "cleared" if alarm.cleared else alarm.level.name.lower()
        counts[kind] = counts.get(kind, 0) + 1
    return ", ".join(f"{count} {name}" for name, count in counts.items())

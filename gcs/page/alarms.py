"""The alarms that are shown: the ground's, and those of the page's own process. Pure; wall-clock times in seconds."""

from collections.abc import Iterable

from formation.messages import Event
from gcs.alarms import MOST, AlarmBook, is_loud, ordered
from wire.ground_state import Alarm, GroundState

LATEST = 8


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
        return is_loud(self.open)


def severities(alarms: Iterable[Alarm]) -> str:
    """How many of which kind, in words; those that are acknowledged are counted as such."""
    counts: dict[str, int] = {}
    for alarm in alarms:
        kind = "acknowledged" if alarm.acknowledged else alarm.severity.name.lower()
        counts[kind] = counts.get(kind, 0) + 1
    return ", ".join(f"{count} {name}" for name, count in counts.items())

"""Safety's alarms until they are over: a drone that is unheard ends none of its own, since nothing is known of it."""

from collections.abc import Iterable, Sequence

from formation.messages import OVER, Event, Severity
from formation.safety.rules import FaultChange
from formation.safety.rules_table import SILENT_S
from gcs.drones.drone import Drone


class OpenAlarms:
    """Turns faults that begin and end into events; those that end while their drone is unheard wait for its word."""

    def __init__(self, drones: Sequence[Drone]) -> None:
        self._drones = {drone.index: drone for drone in drones}
        self._open: dict[tuple[int, str], str] = {}

    @property
    def texts(self) -> tuple[str, ...]:
        """The faults that no rule raises any more, of drones that are still unheard."""
        return tuple(self._open.values())

    def update(self, changes: Iterable[FaultChange], now_ns: int) -> list[Event]:
        """Events for faults that began, and for faults that are over."""
        events = []
        for change in changes:
            key = change.vehicle, change.rule.name
            if change.began:
                if self._open.pop(key, None) is None:
                    events.append(Event(change.rule.severity, "safety", change.text, lasts=True))
            elif not change.rule.of_swarm and self._is_unheard(change.vehicle, now_ns):
                self._open[key] = change.text
            else:
                events.append(_over(change.text))
        ended = [key for key in self._open if not self._is_unheard(key[0], now_ns)]
        return events + [_over(self._open.pop(key)) for key in ended]

    def _is_unheard(self, vehicle: int, now_ns: int) -> bool:
        drone = self._drones.get(vehicle)
        return drone is not None and drone.link.silent_s(now_ns) > SILENT_S


def _over(text: str) -> Event:
    return Event(Severity.NOTICE, "safety", f"{OVER}{text}")

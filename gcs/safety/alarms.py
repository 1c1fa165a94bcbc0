"""Safety's alarms until they are over: a drone that is unheard ends none of its own, since nothing is known of it."""

from collections.abc import Iterable, Sequence

from formation.messages import OVER, Event, Severity
from formation.safety.rules import FaultChange
from formation.safety.rules_table import SILENT_S
from gcs.drones.drone import Drone
from gcs.safety.causes import with_cause


class OpenAlarms:
    """Turns faults that begin and end into events; those that end while their drone is unheard wait for its word."""

    def __init__(self, drones: Sequence[Drone]) -> None:
        self._drones = {drone.index: drone for drone in drones}
        self._open: dict[tuple[int, str], str] = {}
        self._texts: dict[tuple[int, str], str] = {}
        """Of faults that go on: as they were reported."""

    @property
    def texts(self) -> tuple[str, ...]:
        """The faults that no rule raises any more, of drones that are still unheard."""
        return tuple(self._open.values())

    def update(self, changes: Iterable[FaultChange], rejected: Sequence[int], now_ns: int) -> list[Event]:
        """Events for faults that began, each with its first cause, and for faults that are over. rejected: why the
        mocap rejects each body's pose."""
        events = []
        for change in changes:
            key = change.vehicle, change.rule.name
            if change.began:
                text = self._open.pop(key, "")
                self._texts[key] = text or self.text(change, rejected, now_ns)
                if not text:
                    events.append(Event(change.rule.severity, "safety", self._texts[key], lasts=True))
            elif not change.rule.of_swarm and self._is_unheard(change.vehicle, now_ns):
                self._open[key] = self._texts.pop(key, change.text)
            else:
                events.append(_over(self._texts.pop(key, change.text)))
        ended = [key for key in self._open if not self._is_unheard(key[0], now_ns)]
        return events + [_over(self._open.pop(key)) for key in ended]

    def text(self, change: FaultChange, rejected: Sequence[int], now_ns: int) -> str:
        """The text of a fault that begins, with its first cause."""
        drone = None if change.rule.of_swarm else self._drones.get(change.vehicle)
        return change.text if drone is None else with_cause(change, drone.link, rejected[change.vehicle], now_ns)

    def _is_unheard(self, vehicle: int, now_ns: int) -> bool:
        drone = self._drones.get(vehicle)
        return drone is not None and drone.link.silent_s(now_ns) > SILENT_S


def _over(text: str) -> Event:
    return Event(Severity.NOTICE, "safety", f"{OVER}{text}")

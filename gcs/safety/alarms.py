"""Safety's alarms until they are over: a drone that is unheard ends none of its own, since nothing is known of it."""

from collections.abc import Iterable, Sequence

from formation.messages import Event
from formation.safety.rules import FaultChange
from formation.safety.rules_table import SILENT_S
from gcs.drones.drone import Drone
from gcs.safety.causes import with_cause


class OpenAlarms:
    """Turns faults that begin and end into events; those that end while their drone is unheard wait for its word."""

    def __init__(self, drones: Sequence[Drone]) -> None:
        self._drones = {drone.index: drone for drone in drones}
        self._open: dict[tuple[int, str], Event] = {}
        self._begun: dict[tuple[int, str], Event] = {}
        """Of faults that go on: as they were reported."""

    @property
    def texts(self) -> tuple[str, ...]:
        """The faults that no rule raises any more, of drones that are still unheard."""
        return tuple(event.text for event in self._open.values())

    def update(self, changes: Iterable[FaultChange], rejected: Sequence[int], now_ns: int) -> list[Event]:
        """Events for faults that began, each with its first cause, and for faults that are over. rejected: why the
        mocap rejects each body's pose."""
        events = []
        for change in changes:
            key = change.vehicle, change.rule.name
            if change.began and key in self._open:
                self._begun[key] = self._open.pop(key)
            elif change.began:
                self._begun[key] = self._event(change, self.text(change, rejected, now_ns))
                events.append(self._begun[key])
            else:
                begun = self._begun.pop(key, None) or self._event(change, change.text)
                if not change.rule.of_swarm and self._is_unheard(change.vehicle, now_ns):
                    self._open[key] = begun
                else:
                    events.append(begun.over())
        ended = [key for key in self._open if not self._is_unheard(key[0], now_ns)]
        return events + [self._open.pop(key).over() for key in ended]

    def text(self, change: FaultChange, rejected: Sequence[int], now_ns: int) -> str:
        """The text of a fault that begins, with its first cause."""
        drone = None if change.rule.of_swarm else self._drones.get(change.vehicle)
        return change.text if drone is None else with_cause(change, drone.link, rejected[change.vehicle], now_ns)

    def _event(self, change: FaultChange, text: str) -> Event:
        rule = change.rule
        return Event(
            rule.severity, "safety", text, lasts=True, code=rule.name, subject="" if rule.of_swarm else change.body
        )

    def _is_unheard(self, vehicle: int, now_ns: int) -> bool:
        drone = self._drones.get(vehicle)
        return drone is not None and drone.link.silent_s(now_ns) > SILENT_S

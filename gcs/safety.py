"""What safety's rules find, as events until it is over; what the host reports; what a campaign can switch off. Pure."""

from collections.abc import Iterable, Sequence

from formation.control import limits
from formation.messages import Event, EventCode, HostReport, Severity, rejection_text
from formation.safety.rules import FaultChange
from formation.safety.rules_table import BEHIND_HOLD_S, RULE_NAMES, SILENT_S, Measure
from gcs.drones.drone import Drone
from gcs.drones.link_state import DroneLink

ARM_IN_AIR = "arm-in-air"
ARM_OTHER_GROUND = "arm-other-ground"
LOG_TROUBLE = "log-trouble"
STOP_REPEAT = "stop-repeat"
SETPOINT_HOLD_OFF = "setpoint-hold-off"
MONITORS = (*RULE_NAMES, *limits.MONITORS, ARM_IN_AIR, ARM_OTHER_GROUND, LOG_TROUBLE, STOP_REPEAT, SETPOINT_HOLD_OFF)
UNHEARD_S = 0.5
"""Nothing of a drone for so long, of the hundred packets a second that it sends, ended before its motion went wrong."""
_EFFECTS = frozenset(
    {
        Measure.UNSEEN_S, Measure.POSITION_ERROR_M, Measure.LEADER_POSITION_ERROR_M, Measure.NOT_OFFBOARD,
        Measure.DISARMED, Measure.MODEL_MISMATCH, Measure.ATTITUDE_INNOVATION_RAD,
    }
)  # fmt: skip


def check_monitors(without: frozenset[str]) -> None:
    """Raise ValueError for a name that is no monitor."""
    unknown = sorted(without - set(MONITORS))
    if unknown:
        raise ValueError(f"no monitor of the ground: {', '.join(unknown)}")


class Host:
    """The newest report of the host. It forbids arming and touches no output of the control."""

    def __init__(self, without: frozenset[str]) -> None:
        self._without = without
        self._report = HostReport()

    @property
    def other_grounds(self) -> tuple[str, ...]:
        """Other grounds that are alive on the lab's bus."""
        return self._report.other_grounds

    @property
    def log_trouble(self) -> str:
        """What is wrong with the log, in words; empty while it is written in time."""
        return "" if LOG_TROUBLE in self._without else self._report.log_trouble

    @property
    def button_trouble(self) -> str:
        """What is wrong with the stop button, in words; empty while it is there, or none is configured."""
        return self._report.button_trouble

    def receive(self, report: HostReport) -> list[Event]:
        """Receive a report; return events for what is new in it."""
        grounds, before = self.other_grounds, self._troubles
        self._report = report
        events = [
            Event(
                Severity.WARNING,
                "flight",
                f"another ground is alive: {name}",
                code=EventCode.OTHER_GROUND,
                subject=name,
            )
            for name in report.other_grounds
            if name not in grounds
        ]
        for old, new in zip(before, self._troubles, strict=True):
            if new.text and new != old:
                events.append(new)
            elif old.text and not new.text:
                events.append(old.over())
        return events

    @property
    def _troubles(self) -> tuple[Event, ...]:
        """What may be wrong, as events; the text of one that is not is empty."""
        troubles = (
            ("log", self.log_trouble, EventCode.LOG),
            ("security", self._report.exposed, EventCode.INSECURE),
            ("stop button", self.button_trouble, EventCode.STOP_BUTTON),
        )
        return tuple(Event(Severity.CRITICAL, source, text, lasts=True, code=code) for source, text, code in troubles)


def with_cause(change: FaultChange, link: DroneLink, rejected: int, now_ns: int) -> str:
    """The text of a fault that begins, with its first cause. rejected: why the mocap rejects its pose (Rejection)."""
    cause = _first_cause(change, link, rejected, now_ns) if change.rule.measure in _EFFECTS else ""
    return f"{change.text} ({cause})" if cause else change.text


def _first_cause(change: FaultChange, link: DroneLink, rejected: int, now_ns: int) -> str:
    if link.guard_words(now_ns):
        return f"its guard: {link.guard_words(now_ns)}"
    if change.rule.measure is not Measure.UNSEEN_S:
        return "nothing is heard of it" if link.silent_s(now_ns) > UNHEARD_S else ""
    if rejected:
        return f"the mocap rejects its pose: {rejection_text(rejected)}"
    late = link.behind_s(now_ns) > BEHIND_HOLD_S
    return "its telemetry comes late: a slow link, or a busy computer" if late else ""


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

"""The state that a ground publishes ten times a second, and its JSON: one schema for bus, page, watch and scripts.

SI units, `lab` axes. JSON has neither NaN nor infinity: None stands for what is unknown, and for the age of what never
was. Without arrays: operators' commands load it.
"""

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from datetime import datetime
from enum import IntEnum
from functools import cache
from operator import attrgetter
from typing import Any, get_type_hints

from formation.codes import Cause, Phase, Severity, condition_key
from formation.requests import CONFIGURED
from wire.text import parse_object

VERSION = 1
"""Version of the schema; raised with every change of a key's meaning, and with every key that goes."""
Vec3 = tuple[float, float, float]
Quat = tuple[float, float, float, float]


class StateError(ValueError):
    """A text that is no state of this version; in one line, with what to do."""


@dataclass(frozen=True, slots=True)
class DroneState:
    """One commanded drone.

    piloted: a pilot has taken it over. stopped_ms: how long after the stop it reported its motors off.
    link_behind_s: age of its telemetry when it was read; superseded: packets that were dropped unread, since newer ones
    had arrived. battery: 0..1. loss: share of its packets, 0..1, to the ground or
    behind its bridge. rejected: why the pose validator rejects it, in words.
    excluded: it takes no part in the flight.
    """

    sysid: int
    body: str
    autopilot: str | None
    armed: bool
    disarms_in_s: float | None
    mode: str
    goal: str
    piloted: bool
    landed: str
    stopped_ms: float | None
    pos_lab_m: Vec3 | None
    q_lab_from_flu: Quat | None
    reference_lab_m: Vec3 | None
    error_m: float | None
    fence_margin_m: float | None
    age_s: float | None
    heartbeat_age_s: float | None
    battery: float | None
    battery_v: float | None
    link_behind_s: float | None
    superseded: int
    setpoint_age_s: float | None
    clock_offset_s: float | None
    loss: float
    rejected: str | None
    excluded: bool = False


@dataclass(frozen=True, slots=True)
class ObservedBody:
    """A body that is seen and not commanded."""

    body: str
    pos_lab_m: Vec3 | None
    q_lab_from_flu: Quat | None
    age_s: float | None


@dataclass(frozen=True, slots=True)
class Counters:
    """Counters since the start; late_share: of about the last second's frames."""

    frames: int
    missed_frames: int
    late_share: float
    stale_frames: int
    rejected_frames: int
    bad_bytes: int
    bad_packets: int
    lost_packets: int
    superseded_packets: int
    stray_datagrams: int


@dataclass(frozen=True, slots=True)
class Cycles:
    """The machine's control cycles: how many, how many were late, and the worst latency."""

    count: int = 0
    late: int = 0
    worst_ms: float = 0.0


@dataclass(frozen=True, slots=True)
class LogFile:
    """The log's name and size, and the free space on its disk, bytes; None while unknown."""

    name: str = ""
    bytes: int | None = None
    free_bytes: int | None = None


@dataclass(frozen=True, slots=True)
class PublishedEvent:
    """One event; id: events are numbered from 1 on. unix_s: wall-clock time."""

    id: int
    unix_s: float
    severity: Severity
    source: str
    text: str
    code: str = ""
    subject: str = ""


@dataclass(frozen=True, slots=True)
class Alarm:
    """One alarm: when it came last, how severe, whose, in words; code, subject: as of its event; times: how often.

    goes_on: its condition has not ended; cleared: it has. What has no duration is neither. acknowledged: an operator
    has read it.
    """

    unix_s: float
    severity: Severity
    source: str
    text: str
    code: str = ""
    subject: str = ""
    times: int = 1
    goes_on: bool = False
    acknowledged: bool = False
    cleared: bool = False

    @property
    def key(self) -> tuple[str, str, str]:
        """The key that it shares with the events of its condition (formation.messages.Event.key)."""
        return condition_key(self.source, self.code, self.subject, self.text)

    @property
    def level(self) -> Severity:
        """CRITICAL, ERROR or WARNING: what is worse than critical asks for no more."""
        return max(self.severity, Severity.CRITICAL)

    @property
    def time(self) -> str:
        """The local time at which it came last."""
        return f"{datetime.fromtimestamp(self.unix_s):%H:%M:%S}"

    @property
    def line(self) -> str:
        """Time, level, how often, and the words, in a line that may be cut at its end."""
        seen, times = "seen " if self.acknowledged else "", f"{self.times}x " if self.times > 1 else ""
        return f"{self.time} {self.level.name} {seen}{times}{self.source}: {self.text}"


@dataclass(frozen=True, slots=True, kw_only=True)
class GroundState:
    """Everything an operator may want to see of a ground.

    cause, cause_code: why it is in that phase, for phase_s. t_s: since its start. armed: in ARMED, whether every drone
    has armed. not_landed: drones whose motors may still turn, though the landing or the stop is over. open_alarms:
    faults that no rule raises any more, of drones that are still unheard. allowed: by verb, every reason against it
    now; none where it may be asked. reject_codes: their names (formation.reasons). prearm_failures: why it would not
    arm, while on the ground. trajectory_s: time along the leader's trajectory, and its duration; trajectory_from: x, y,
    z and heading where it began. battery_levels: the charges, 0..1, under which a drone's is low, and empty. rejected:
    by body, why the pose validator rejects it now. log_trouble, button_trouble: in words; empty while all is well.
    cycles and what follows is the host's, and has its default where a core is asked alone. lost_lines: of its output.
    """

    version: int = VERSION
    phase: Phase
    cause: str
    cause_code: Cause
    t_s: float
    phase_s: float
    ground_session: int
    log_trouble: str
    button_trouble: str
    armed: bool
    not_landed: tuple[str, ...]
    open_alarms: tuple[str, ...]
    allowed: Mapping[str, tuple[str, ...]]
    reject_codes: Mapping[str, tuple[str, ...]]
    trajectory: str = CONFIGURED
    trajectory_started: bool
    trajectory_done: bool
    trajectory_s: tuple[float, float] | None
    trajectory_from: Quat | None
    landing_left_s: float | None
    shape: str
    slots_lead_m: tuple[Vec3, ...]
    drones: tuple[DroneState, ...]
    observed: tuple[ObservedBody, ...]
    leader_yaw_rad: float | None
    battery_levels: tuple[float, float] = (0.0, 0.0)
    rejected: Mapping[str, str]
    prearm_failures: tuple[str, ...]
    counters: Counters
    cycles: Cycles = Cycles()
    log: LogFile = LogFile()
    events: tuple[PublishedEvent, ...] = ()
    alarms: tuple[Alarm, ...] = ()
    lost_lines: int = 0

    @property
    def left_out(self) -> str:
        """The bodies that take no part in the flight, in words; empty for none."""
        bodies = ", ".join(drone.body for drone in self.drones if drone.excluded)
        return f"left out: {bodies}" if bodies else ""

    @property
    def motors_on(self) -> Mapping[str, bool]:
        """Whether each drone is armed, by body, of those that were heard: of others a new ground does not know it."""
        return {drone.body: drone.armed for drone in self.drones if drone.heartbeat_age_s is not None}


def encode(state: GroundState) -> str:
    """Encode a state: the keys are the fields' names, an IntEnum is its member's name."""
    older = {"refusals": state.prearm_failures}  # its name before 0.3; until 0.4
    return json.dumps(_as_object(state) | older, default=_as_object)


def decode(text: str) -> GroundState:
    """Decode a state; StateError names both versions where it is of another one, and JsonError says what is no JSON."""
    from pydantic import ValidationError  # a command that shows no state does without

    values = _current(text)
    try:
        state: GroundState = _adapter().validate_python(values)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        where = ".".join(map(str, first["loc"]))
        raise StateError(f"no state of a ground, though of version {VERSION}: {where}: {first['msg']}") from error
    return state


@cache
def _adapter() -> Any:
    from pydantic import TypeAdapter

    return TypeAdapter(GroundState)


def _current(text: str) -> dict[str, Any]:
    """The state's JSON object, which is of this version."""
    values = parse_object(text)
    found = values.get("version", 0)
    if found != VERSION:
        raise StateError(
            f"the ground publishes its state in version {found!r:.20}, this program reads version {VERSION}: "
            "install the same release of mavlink-formation on both computers"
        )
    return values


def _as_object(message: Any) -> dict[str, Any]:
    kind: Any = type(message)
    names, values, enums = _layout(kind)
    made = dict(zip(names, values(message), strict=True))
    for name in enums:
        made[name] = made[name].name
    return made


@cache
def _layout(kind: Any) -> tuple[tuple[str, ...], Callable[[object], tuple[Any, ...]], tuple[str, ...]]:
    """The names of a dataclass's fields, what gets their values, and the names of those that are IntEnums."""
    hints = get_type_hints(kind)
    enums = (name for name, hint in hints.items() if isinstance(hint, type) and issubclass(hint, IntEnum))
    return tuple(hints), attrgetter(*hints), tuple(enums)

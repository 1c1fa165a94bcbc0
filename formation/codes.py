"""What programs decide on: phase, severity, causes, events, outcomes. Without arrays: operators' commands load it."""

import re
from dataclasses import dataclass
from enum import IntEnum, StrEnum, auto


class _Named(IntEnum):
    """One whose members can be had by their names, as JSON has them."""

    @classmethod
    def _missing_(cls, value: object) -> "_Named | None":
        return cls.__members__.get(value) if isinstance(value, str) else None


class Phase(_Named):
    """Where the flight is; the whole swarm shares one phase (formation.safety.phases)."""

    GROUND = 0
    ARMED = 1
    TAKEOFF = 2
    FORMATION = 3
    HOLD = 4
    LAND = 5
    STOPPED = 6


class Severity(_Named):
    """MAV_SEVERITY's scale, the one every operator knows."""

    EMERGENCY = 0
    ALERT = 1
    CRITICAL = 2
    ERROR = 3
    WARNING = 4
    NOTICE = 5
    INFO = 6
    DEBUG = 7


class Cause(StrEnum):
    """Why the phase changed."""

    UNKNOWN = auto()  # in a log of a version that did not record it
    START = auto()
    OPERATOR = auto()
    FAULT = auto()  # a rule of formation.safety.rules_table
    AT_HEIGHT = auto()
    LANDED = auto()
    LEFT_TO_PILOT = auto()
    NOT_LANDED = auto()
    NOT_ARMED = auto()
    DISARMED = auto()
    LANDS_ITSELF = auto()
    INPUT_LOST = auto()  # of who moves a drone by hand


class EventCode(StrEnum):
    """What an event reports, where that is no rule, which has its own name, and no pose's Rejection."""

    ACKNOWLEDGED = auto()
    PHASE = auto()
    REQUEST_REJECTED = auto()
    INPUT_REJECTED = auto()
    LOG = auto()
    STOP_BUTTON = auto()
    INSECURE = auto()
    OTHER_GROUND = auto()
    GROUND_SILENT = auto()
    GROUND_FAILED = auto()
    LAW_FAILED = auto()
    PARAMETER = auto()
    TAKE_OFF_WINDOW = auto()
    TAKE_OFF_TOO_LATE = auto()
    PILOT = auto()
    RELEASED = auto()
    EXCLUDED = auto()
    REPLACED = auto()
    NOT_LANDED = auto()
    TRAJECTORY = auto()
    SHAPE = auto()
    HOME = auto()
    MOVED = auto()


_NUMBER = re.compile(r"-?\d+(\.\d+)?")


def condition_key(source: str, code: str, subject: str, text: str) -> tuple[str, str, str]:
    """What events and alarms of one condition have in common; without a code, their words but for the numbers."""
    return source, code, subject if code else _NUMBER.sub("#", text)


class FlightResult(StrEnum):
    """How a flight ended."""

    LANDED = "landed"
    HELD = "held"
    LOST = "lost"
    CUT = "cut"
    ABORTED = "aborted"
    LAW_FAILED = "law failed"
    IMPORTED = "imported"  # another's log, which does not say how it ended
    STARVED = "starved"  # no flight: the machine gave a simulator too little time


GOOD_RESULTS = frozenset({FlightResult.LANDED, FlightResult.HELD, FlightResult.IMPORTED})
"""Of a flight that ended as it was asked to."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """How a flight ended, and why, where that is not as it was asked to."""

    result: FlightResult
    reason: str = ""

    @property
    def is_good(self) -> bool:
        """Whether it ended as it was asked to."""
        return self.result in GOOD_RESULTS

    def __str__(self) -> str:
        return f"{self.result}: {self.reason}" if self.reason else self.result.value

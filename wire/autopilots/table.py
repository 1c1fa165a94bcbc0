"""The form of one autopilot's table: its modes and their numbers, its parameters, what it needs. Data only.

From it the ground builds what it asks of such an autopilot (gcs.drones.autopilot_model), the agent what it is
(drone_agent.autopilots).
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from enum import Enum, auto

from wire.link_messages import Heartbeat, MavAutopilot, ParamType


class FlightMode(Enum):
    """The flight modes of every autopilot, by what they mean."""

    MANUAL = auto()
    STABILIZED = auto()
    ACRO = auto()
    ALTITUDE = auto()
    POSITION = auto()
    HOLD = auto()
    MISSION = auto()
    RETURN = auto()
    TAKEOFF = auto()
    LAND = auto()
    OFFBOARD = auto()
    OFFBOARD_NO_POSITION = auto()
    BRAKE = auto()
    DESCEND = auto()
    TERMINATION = auto()


STREAM_MODES = (FlightMode.OFFBOARD, FlightMode.OFFBOARD_NO_POSITION)
"""In which a stream of setpoints is followed."""


@dataclass(frozen=True, slots=True)
class ModeNumber:
    """One mode as DO_SET_MODE asks for it, and its names: as ground stations show it, and in its own texts."""

    main: int
    sub: int
    name: str
    label: str


@dataclass(frozen=True, slots=True)
class ParamSpec:
    """One parameter: its type, default, documented range and meaning."""

    name: str
    type: ParamType
    default: float
    low: float
    high: float
    meaning: str


def real(name: str, default: float, low: float, high: float, meaning: str) -> ParamSpec:
    """A float parameter."""
    return ParamSpec(name, ParamType.REAL32, default, low, high, meaning)


def whole(name: str, default: int, low: int, high: int, meaning: str, kind: ParamType = ParamType.INT32) -> ParamSpec:
    """An integer parameter; PX4's are all INT32."""
    return ParamSpec(name, kind, default, low, high, meaning)


def by_name(specs: Iterable[ParamSpec]) -> dict[str, ParamSpec]:
    """Specs as a table holds them."""
    return {spec.name: spec for spec in specs}


@dataclass(frozen=True, slots=True)
class AutopilotTable:
    """One autopilot. `modes` may name one number twice: the first entry is what that number is read as."""

    autopilot: MavAutopilot
    name: str
    modes: Mapping[FlightMode, ModeNumber]
    join: Callable[[int, int], int]
    """DO_SET_MODE's custom mode and sub-mode -> HEARTBEAT's and SET_MODE's custom mode."""
    split: Callable[[int], tuple[int, int]]
    """The other way round."""
    auto_main: int | None
    """The main mode whose sub-modes are modes of their own; those of others make no difference here."""
    parameters: Mapping[str, ParamSpec]
    indoor: Mapping[str, float]
    """Parameters of one that is flown on motion capture alone, as it was seen to need them."""
    system_parameter: str
    hover_parameter: str
    idle_disarm_parameter: str
    """After how many seconds it disarms when armed without a take-off; never where that is zero or less."""
    read_at_boot: frozenset[str]
    """Parameters of this table that count from the next boot on, as its documentation says."""
    needs_origin: bool
    """Whether it fuses external poses only after SET_GPS_GLOBAL_ORIGIN gave its local frame an origin on the globe."""
    inertial_delay_s: float
    """Mean age, at its stamp, of what HIGHRES_IMU shows: of a filter's delay, or half of what it is the mean of."""

    def custom_mode(self, mode: FlightMode) -> int:
        """HEARTBEAT's custom mode in that mode."""
        number = self.modes[mode]
        return self.join(number.main, number.sub)

    def mode_at(self, main: int, sub: int) -> FlightMode | None:
        """The mode of DO_SET_MODE's two numbers; None for one that is none of ours."""
        for mode, number in self.modes.items():
            if number.main == main and (main != self.auto_main or number.sub == sub):
                return mode
        return None

    def is_of(self, beat: Heartbeat) -> bool:
        """Whether such an autopilot sent a HEARTBEAT. The number GENERIC is anybody's: there its mode says it."""
        known = beat.autopilot is not MavAutopilot.GENERIC or self.mode_of(beat.custom_mode) is not None
        return beat.autopilot is self.autopilot and known

    def mode_of(self, custom_mode: int) -> FlightMode | None:
        """The mode of a HEARTBEAT's custom mode."""
        return self.mode_at(*self.split(custom_mode))

    def mode_name(self, custom_mode: int) -> str:
        """The short name of a HEARTBEAT's custom mode, or its number."""
        mode = self.mode_of(custom_mode)
        if mode is not None:
            return self.modes[mode].name
        main, sub = self.split(custom_mode)
        return f"AUTO {sub}" if main == self.auto_main else f"MODE {main}"

    def default(self, parameter: str) -> float:
        """A parameter's value before anyone has changed it; KeyError for one that is not in the table."""
        return self.parameters[parameter].default

"""What makes an autopilot one make or the other: its modes and numbers, rules, words, parameters, rates. Tables only.

`drone_agent.autopilots.px4` and `drone_agent.autopilots.ardupilot` fill it; everything else asks it.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import Enum, Flag, auto

from drone_agent.autopilots.parameters import Parameters, ParamSpec
from formation.messages import Severity
from wire.link_messages.commands import Result
from wire.link_messages.packet import LinkMessage
from wire.link_messages.setpoints import AttitudeSetpoint
from wire.link_messages.status import Autopilot


class Mode(Enum):
    """The flight modes of either make, by what they mean."""

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


class Task(Enum):
    """What the autopilot does with the vehicle, whatever the mode is called."""

    LEVEL = auto()
    HOLD = auto()
    TAKEOFF = auto()
    RETURN = auto()
    LAND = auto()
    DESCEND = auto()
    EXTERNAL = auto()
    OFF = auto()


class Needs(Flag):
    """What must be there for a mode to be flown."""

    NOTHING = 0
    POSITION = auto()
    STREAM = auto()
    PILOT = auto()
    MISSION = auto()
    GLOBE = auto()
    """To know where on the globe it is: an external pose alone does not say."""


@dataclass(frozen=True, slots=True)
class ModeRow:
    """One mode: its number on the wire, MAV_MODE_FLAG bits beside armed, what it does and needs, its name."""

    custom_mode: int
    flags: int
    task: Task
    needs: Needs
    label: str
    may_arm: bool = True


@dataclass(frozen=True, slots=True)
class StreamLoss:
    """What the autopilot itself does about a dead stream: after how long, which mode it shows, what it flies.

    mode None: the mode stays, and the stream may come back to it.
    """

    after_s: float
    mode: Mode | None
    task: Task


@dataclass(frozen=True, slots=True)
class Words:
    """STATUSTEXTs, as the operators of this make know them; {} takes a reason or a mode's name, "" says nothing."""

    boot: tuple[tuple[Severity, str], ...]
    armed: str
    disarmed: str
    arm_refused: tuple[str, ...]
    disarm_refused: str
    mode_refused: str
    no_position: str
    not_armable: str
    takeoff: str
    landing: str
    landed: str
    stream_lost: str
    pose_lost: str
    battery_low: str
    battery_critical: str
    ground_lost: str
    unknown_parameter: str


@dataclass(frozen=True, slots=True)
class ModeRequest:
    """What a DO_SET_MODE or SET_MODE asks for; None of a mode it names wrongly."""

    mode: Mode | None
    refusal: Result = Result.DENIED


@dataclass(frozen=True, slots=True)
class Timing:
    """The make's own waits, read from its parameters when they are needed; seconds, metres, metres per second."""

    takeoff_height_m: float
    climb_m_s: float
    land_m_s: float
    disarm_landing_s: float
    """Landed in a mode that lands; these waits are off where negative."""
    disarm_flown_s: float
    """Landed after a flight, in any other mode."""
    disarm_idle_s: float
    """Armed and never taken off."""
    ground_loss_s: float
    ground_loss: Mode | None
    battery_low: float
    battery_critical: float
    battery_action: Mode | None
    return_height_m: float
    return_slope: float


@dataclass(frozen=True, slots=True)
class Personality:
    """One make of autopilot."""

    name: str
    autopilot: Autopilot
    vehicle_type: int
    version: int
    capabilities: int
    modes: Mapping[Mode, ModeRow]
    boot_mode: Mode
    refused: Result
    """The MAV_RESULT of an arming, mode change or take-off that the moment does not allow."""
    no_such_rate: Result
    no_such_message: Result
    set_mode_ack: int
    """The number under which a SET_MODE is acknowledged."""
    force_arm: bool
    """Whether arming can be forced past its checks."""
    takeoff_in_own_mode: bool
    """PX4 switches to a take-off mode, armed or not; ArduPilot takes off within GUIDED, armed."""
    parameters: tuple[ParamSpec, ...]
    system_parameter: str
    hover_parameter: str
    rates_hz: Mapping[int, float]
    """MAVLink message id -> default rate of telemetry."""
    words: Words
    timing: Callable[[Parameters], Timing]
    mode_request: Callable[[int, int, int], ModeRequest]
    """DO_SET_MODE's base mode, custom mode and sub-mode -> what is asked for."""
    custom_parts: Callable[[int], tuple[int, int]]
    """SET_MODE's custom mode -> the custom mode and sub-mode of a DO_SET_MODE."""
    stream_loss: Callable[[Parameters], StreamLoss]
    takes_target: Callable[[AttitudeSetpoint], bool]
    """Whether a SET_ATTITUDE_TARGET is well formed for this make; another one stops the vehicle."""
    streams_positions: bool
    """Whether a position must be sent again and again; ArduPilot goes where it was told once."""
    climb_rate_of: Callable[[Parameters, float], float | None]
    """SET_ATTITUDE_TARGET's thrust as a climb rate, m/s, or None where it is thrust."""
    indoor: Mapping[str, float]
    """The parameters of one flown on an external pose alone."""
    needs_origin: bool
    """Whether an external pose is of no use to it before SET_GPS_GLOBAL_ORIGIN."""
    takes_pose: Callable[[Parameters, LinkMessage], bool]
    """Whether the estimator fuses this message, as it is set up."""
    system_status: Callable[[bool, bool, bool, bool], int]
    """armed, landed, failsafe, ready -> MAV_STATE."""
    estimator_flags: Callable[[bool, bool], int]
    """position valid, ready -> flags of ESTIMATOR_STATUS or EKF_STATUS_REPORT."""

"""One autopilot as the agent simulates it: its table's modes and parameters, rules, words, rates. Data only.

`drone_agent.autopilots.px4` and `drone_agent.autopilots.ardupilot` fill it; everything else asks it.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from enum import Enum, Flag, auto
from types import MappingProxyType

from drone_agent.autopilots.parameters import Parameters
from formation.maths.arrays import Float
from formation.messages import Severity
from wire.autopilots.table import AutopilotTable, FlightMode
from wire.link_messages import (
    AttitudeSetpoint,
    EstimatorFlag,
    LinkMessage,
    MavState,
    ModeFlag,
    ProtocolCapability,
    Result,
)

ATTITUDE_ONLY = (
    EstimatorFlag.ATTITUDE
    | EstimatorFlag.VELOCITY_VERT
    | EstimatorFlag.POS_VERT_ABS
    | EstimatorFlag.POS_VERT_AGL
    | EstimatorFlag.CONST_POS_MODE
)
"""An estimator that knows which way is up, and how high it is."""
POSITIONED = (ATTITUDE_ONLY & ~EstimatorFlag.CONST_POS_MODE) | (
    EstimatorFlag.VELOCITY_HORIZ
    | EstimatorFlag.POS_HORIZ_REL
    | EstimatorFlag.POS_HORIZ_ABS
    | EstimatorFlag.PRED_POS_HORIZ_REL
    | EstimatorFlag.PRED_POS_HORIZ_ABS
)


class Task(Enum):
    """The autopilot's use of the vehicle, whatever the mode is called."""

    LEVEL = auto()
    HOLD = auto()
    TAKEOFF = auto()
    RETURN = auto()
    LAND = auto()
    DESCEND = auto()
    EXTERNAL = auto()
    OFF = auto()


class Needs(Flag):
    """The inputs that a mode needs to be flown."""

    NOTHING = 0
    POSITION = auto()
    STREAM = auto()
    PILOT = auto()
    MISSION = auto()
    GLOBE = auto()
    """To know where on the globe it is: an external pose alone does not say."""


@dataclass(frozen=True, slots=True)
class ModeRow:
    """One mode: its number on the wire, base mode beside armed, what it does and needs, its name."""

    custom_mode: int
    flags: ModeFlag
    task: Task
    needs: Needs
    label: str
    may_arm: bool = True


def mode_rows(
    table: AutopilotTable, rows: Iterable[tuple[FlightMode, ModeFlag, Task, Needs, bool]]
) -> Mapping[FlightMode, ModeRow]:
    """The table's modes with what each does: base mode, task, needs, whether it may be armed in."""
    return MappingProxyType(
        {
            mode: ModeRow(table.custom_mode(mode), flags, task, needs, table.modes[mode].label, may_arm)
            for mode, flags, task, needs, may_arm in rows
        }
    )


@dataclass(frozen=True, slots=True)
class StreamLoss:
    """The autopilot's own reaction to a dead stream: after how long, which mode it shows, what it flies.

    mode None: the mode stays, and the stream may come back to it.
    """

    after_s: float
    mode: FlightMode | None
    task: Task


@dataclass(frozen=True, slots=True)
class StatusTexts:
    """STATUSTEXTs, as its operators know them; {} takes a reason or a mode's name, "" says nothing."""

    boot: tuple[tuple[Severity, str], ...]
    armed: str
    disarmed: str
    arm_rejected: tuple[str, ...]
    disarm_rejected: str
    mode_rejected: str
    no_position: str
    not_armable: str
    takeoff: str
    landing: str
    landed: str
    stream_lost: str
    attitude_lost: str
    pose_lost: str
    battery_low: str
    battery_critical: str
    ground_lost: str
    unknown_parameter: str


@dataclass(frozen=True, slots=True)
class ModeRequest:
    """The mode that a DO_SET_MODE or SET_MODE asks for; None for one that is named wrongly."""

    mode: FlightMode | None
    result: Result = Result.DENIED


@dataclass(frozen=True, slots=True)
class Timing:
    """The autopilot's own waits, read from its parameters when they are needed; seconds, metres, metres per second."""

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
    ground_loss: FlightMode | None
    battery_low: float
    battery_critical: float
    battery_action: FlightMode | None
    return_height_m: float
    return_slope: float


@dataclass(frozen=True, slots=True)
class Fusion:
    """How the estimator fuses poses.

    noise_and_limits (4): standard deviations of position, m, and heading, rad; the limits of their innovations, in
    standard deviations. A pose rejected for reset_after_s is taken for true; a position not fused for valid_s is lost.
    """

    noise_and_limits: Float
    reset_after_s: float
    valid_s: float


@dataclass(frozen=True, slots=True)
class AttitudeFailure:
    """Motors off where the tilt has been over tilt_rad for after_s."""

    tilt_rad: float
    after_s: float


@dataclass(frozen=True, slots=True)
class AutopilotModel:
    """One autopilot as its peers see it."""

    name: str
    table: AutopilotTable
    version: int
    capabilities: ProtocolCapability
    modes: Mapping[FlightMode, ModeRow]
    boot_mode: FlightMode
    rejected: Result
    """The MAV_RESULT of an arming, mode change or take-off that the moment does not allow."""
    no_such_rate: Result
    no_such_message: Result
    set_mode_ack: int
    """The number under which a SET_MODE is acknowledged."""
    force_arm: bool
    """Whether arming can be forced past its checks."""
    takeoff_in_own_mode: bool
    """PX4 switches to a take-off mode, armed or not; ArduPilot takes off within GUIDED, armed."""
    restores_mode: bool
    """Disarmed in a mode that may not arm, PX4 goes back to the last one that may; ArduPilot stays, until asked."""
    fence_parameter: str | None
    """Whether its fence is on. PX4 says nothing of its fence in SYS_STATUS, which MAVProxy reads as a breach."""
    rates_hz: Mapping[int, float]
    """MessageId -> default rate of telemetry."""
    direct_rates_hz: Mapping[int, float]
    """The same on a UDP link of its own, where that differs: a ground must keep up with what real ones send there."""
    texts: StatusTexts
    timing: Callable[[Parameters], Timing]
    mode_request: Callable[[int, int, int], ModeRequest]
    """DO_SET_MODE's base mode, custom mode and sub-mode -> what is asked for."""
    stream_loss: Callable[[Parameters], StreamLoss]
    accepts_target: Callable[[AttitudeSetpoint], bool]
    """Whether a SET_ATTITUDE_TARGET is well formed for it; another one stops the vehicle."""
    streams_positions: bool
    """Whether a position must be sent again and again; ArduPilot keeps the last target."""
    climb_rate_of: Callable[[Parameters, float], float | None]
    """SET_ATTITUDE_TARGET's thrust as a climb rate, m/s, or None where it is thrust."""
    fuses_pose: Callable[[Parameters, LinkMessage], bool]
    """Whether the estimator fuses this message, as it is set up."""
    fusion: Callable[[Parameters], Fusion]
    attitude_failure: Callable[[Parameters], AttitudeFailure | None]
    system_status: Callable[[bool, bool, bool, bool], MavState]
    """armed, landed, failsafe, ready -> MAV_STATE."""
    estimator_flags: Callable[[bool, bool], EstimatorFlag]
    """position valid, ready -> flags of ESTIMATOR_STATUS or EKF_STATUS_REPORT."""

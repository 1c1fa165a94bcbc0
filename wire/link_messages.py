"""What crosses one drone's MAVLink link, in lab and flu axes and SI units; `wire.mavlink` is its only encoding.

Every message names the MAVLink message it stands for. Times that ride on the link are the sender's own clock.
"""

from dataclasses import dataclass
from enum import IntEnum, IntFlag

from formation.arrays import Quat, Vec3
from formation.messages import Severity

BROADCAST = 0
GROUND_SYSTEM, GROUND_COMPONENT = 255, 190
DRONE_COMPONENT = 1


@dataclass(frozen=True, slots=True)
class Address:
    """A MAVLink system and component."""

    system: int
    component: int


GROUND = Address(GROUND_SYSTEM, GROUND_COMPONENT)


class Autopilot(IntEnum):
    """MAV_AUTOPILOT, those we speak with."""

    GENERIC = 0
    ARDUPILOT = 3
    INVALID = 8  # a ground station's own heartbeat
    PX4 = 12


@dataclass(frozen=True, slots=True)
class Heartbeat:
    """HEARTBEAT (0)."""

    autopilot: Autopilot
    vehicle_type: int
    base_mode: int
    custom_mode: int
    system_status: int


class Ignore(IntFlag):
    """ATTITUDE_TARGET_TYPEMASK."""

    NONE = 0
    ROLL_RATE = 1
    PITCH_RATE = 2
    YAW_RATE = 4
    BODY_RATES = 7
    THRUST = 64
    ATTITUDE = 128


@dataclass(frozen=True, slots=True, eq=False)
class AttitudeSetpoint:
    """SET_ATTITUDE_TARGET (82)."""

    target: Address
    t_boot_ms: int
    q_lab_from_flu: Quat
    rate_flu_rad_s: Vec3
    thrust_norm: float
    ignore: Ignore


class LocalFrame(IntEnum):
    """MAV_FRAME of a position setpoint: absolute, from here in lab axes, in body axes, from here in body axes."""

    LOCAL = 1
    LOCAL_OFFSET = 7
    BODY = 8
    BODY_OFFSET = 9


class PositionIgnore(IntFlag):
    """POSITION_TARGET_TYPEMASK."""

    NONE = 0
    POSITION = 7
    VELOCITY = 56
    ACCELERATION = 448
    FORCE = 512
    YAW = 1024
    YAW_RATE = 2048


@dataclass(frozen=True, slots=True, eq=False)
class PositionSetpoint:
    """SET_POSITION_TARGET_LOCAL_NED (84): vectors in lab axes, or the body's forward, left, up, by `frame`."""

    target: Address
    t_boot_ms: int
    frame: LocalFrame
    ignore: PositionIgnore
    pos_m: Vec3
    vel_m_s: Vec3
    acc_m_s2: Vec3
    yaw_rad: float
    yaw_rate_rad_s: float


@dataclass(frozen=True, slots=True, eq=False)
class VisionPose:
    """VISION_POSITION_ESTIMATE (102): an external pose for the autopilot's estimator (Euler on the wire)."""

    t_us: int
    pos_lab_m: Vec3
    q_lab_from_flu: Quat


@dataclass(frozen=True, slots=True, eq=False)
class MocapPose:
    """ATT_POS_MOCAP (138)."""

    t_us: int
    pos_lab_m: Vec3
    q_lab_from_flu: Quat


class OdometryFrame(IntEnum):
    """MAV_FRAME of ODOMETRY's pose; velocity is always in the body's axes."""

    LOCAL_NED = 1
    LOCAL_FRD = 20


class EstimatorType(IntEnum):
    """MAV_ESTIMATOR_TYPE."""

    UNKNOWN = 0
    NAIVE = 1
    VISION = 2
    VIO = 3
    GPS = 4
    GPS_INS = 5
    MOCAP = 6
    LIDAR = 7
    AUTOPILOT = 8


@dataclass(frozen=True, slots=True, eq=False)
class Odometry:
    """ODOMETRY (331), child frame BODY_FRD; NaN velocity is unknown."""

    t_us: int
    frame: OdometryFrame
    estimator: EstimatorType
    pos_lab_m: Vec3
    q_lab_from_flu: Quat
    vel_flu_m_s: Vec3
    rate_flu_rad_s: Vec3
    reset_counter: int = 0


@dataclass(frozen=True, slots=True, eq=False)
class Attitude:
    """ATTITUDE (30) (Euler on the wire)."""

    t_boot_ms: int
    q_lab_from_flu: Quat
    rate_flu_rad_s: Vec3


@dataclass(frozen=True, slots=True, eq=False)
class AttitudeQuaternion:
    """ATTITUDE_QUATERNION (31)."""

    t_boot_ms: int
    q_lab_from_flu: Quat
    rate_flu_rad_s: Vec3


@dataclass(frozen=True, slots=True, eq=False)
class LocalPosition:
    """LOCAL_POSITION_NED (32), in lab axes."""

    t_boot_ms: int
    pos_lab_m: Vec3
    vel_lab_m_s: Vec3


@dataclass(frozen=True, slots=True, eq=False)
class GlobalPosition:
    """GLOBAL_POSITION_INT (33); degrees, metres; heading is the yaw about lab z, None where unknown."""

    t_boot_ms: int
    lat_deg: float
    lon_deg: float
    alt_m: float
    height_m: float
    vel_lab_m_s: Vec3
    heading_rad: float | None


@dataclass(frozen=True, slots=True, eq=False)
class HomePosition:
    """HOME_POSITION (242)."""

    lat_deg: float
    lon_deg: float
    alt_m: float
    pos_lab_m: Vec3


@dataclass(frozen=True, slots=True)
class SysStatus:
    """SYS_STATUS (1): sensor bit masks, load 0..1, battery."""

    sensors_present: int
    sensors_enabled: int
    sensors_healthy: int
    load: float
    battery_v: float
    battery_a: float
    battery_remaining: float


@dataclass(frozen=True, slots=True)
class Battery:
    """BATTERY_STATUS (147), one pack; remaining 0..1."""

    cell_v: tuple[float, ...]
    current_a: float
    consumed_mah: float
    remaining: float


class LandedState(IntEnum):
    """MAV_LANDED_STATE."""

    UNDEFINED = 0
    ON_GROUND = 1
    IN_AIR = 2
    TAKEOFF = 3
    LANDING = 4


@dataclass(frozen=True, slots=True)
class ExtendedSysState:
    """EXTENDED_SYS_STATE (245)."""

    landed: LandedState


@dataclass(frozen=True, slots=True)
class EkfStatus:
    """EKF_STATUS_REPORT (193, ArduPilot) and ESTIMATOR_STATUS (230, PX4) flags."""

    flags: int
    ardupilot: bool


@dataclass(frozen=True, slots=True)
class StatusText:
    """STATUSTEXT (253); longer texts are chunked on the wire and joined again."""

    severity: Severity
    text: str


@dataclass(frozen=True, slots=True)
class Command:
    """COMMAND_LONG (76)."""

    target: Address
    command: int
    params: tuple[float, float, float, float, float, float, float]
    confirmation: int = 0


@dataclass(frozen=True, slots=True)
class CommandInt:
    """COMMAND_INT (75); x, y as sent (degrees * 1e7 or metres * 1e4, by frame)."""

    target: Address
    frame: int
    command: int
    params: tuple[float, float, float, float]
    x: int
    y: int
    z: float


class Result(IntEnum):
    """MAV_RESULT."""

    ACCEPTED = 0
    TEMPORARILY_REJECTED = 1
    DENIED = 2
    UNSUPPORTED = 3
    FAILED = 4
    IN_PROGRESS = 5
    CANCELLED = 6
    COMMAND_LONG_ONLY = 7
    COMMAND_INT_ONLY = 8
    UNSUPPORTED_FRAME = 9


@dataclass(frozen=True, slots=True)
class CommandAck:
    """COMMAND_ACK (77); progress 0..100 or 255 where unknown."""

    target: Address
    command: int
    result: Result
    progress: int = 255


@dataclass(frozen=True, slots=True)
class SetMode:
    """SET_MODE (11), the old way, still sent by mavutil and MAVProxy."""

    target_system: int
    base_mode: int
    custom_mode: int


@dataclass(frozen=True, slots=True)
class TimeSync:
    """TIMESYNC (111): ts1 is the sender's stamp, tc1 zero in a request."""

    tc1_ns: int
    ts1_ns: int
    target: Address = Address(0, 0)


@dataclass(frozen=True, slots=True)
class Ping:
    """PING (4)."""

    t_us: int
    seq: int
    target: Address


@dataclass(frozen=True, slots=True)
class SystemTime:
    """SYSTEM_TIME (2)."""

    t_unix_us: int
    t_boot_ms: int


class ParamType(IntEnum):
    """MAV_PARAM_TYPE."""

    UINT8 = 1
    INT8 = 2
    UINT16 = 3
    INT16 = 4
    UINT32 = 5
    INT32 = 6
    UINT64 = 7
    INT64 = 8
    REAL32 = 9
    REAL64 = 10


@dataclass(frozen=True, slots=True)
class ParamValue:
    """PARAM_VALUE (22). `raw` is the float field as it rides; PX4 puts integers in bytewise, ArduPilot casts."""

    name: str
    raw: bytes
    type: ParamType
    count: int
    index: int


@dataclass(frozen=True, slots=True)
class ParamSet:
    """PARAM_SET (23); `raw` as in ParamValue."""

    target: Address
    name: str
    raw: bytes
    type: ParamType


@dataclass(frozen=True, slots=True)
class ParamRequestRead:
    """PARAM_REQUEST_READ (20); by index where it is >= 0."""

    target: Address
    name: str
    index: int = -1


@dataclass(frozen=True, slots=True)
class ParamRequestList:
    """PARAM_REQUEST_LIST (21)."""

    target: Address


@dataclass(frozen=True, slots=True)
class AutopilotVersion:
    """AUTOPILOT_VERSION (148)."""

    capabilities: int
    flight_sw_version: int
    uid: int


@dataclass(frozen=True, slots=True, eq=False)
class AttitudeTargetReport:
    """ATTITUDE_TARGET (83): what the autopilot is tracking."""

    t_boot_ms: int
    q_lab_from_flu: Quat
    rate_flu_rad_s: Vec3
    thrust_norm: float
    ignore: Ignore


@dataclass(frozen=True, slots=True, eq=False)
class SimTruth:
    """HIL_STATE_QUATERNION (115) or SIM_STATE (108): a simulated autopilot's true state."""

    t_us: int
    q_lab_from_flu: Quat
    vel_lab_m_s: Vec3
    lat_deg: float
    lon_deg: float
    alt_m: float


@dataclass(frozen=True, slots=True)
class SetOrigin:
    """SET_GPS_GLOBAL_ORIGIN (48): where on the globe the local frame begins."""

    target_system: int
    lat_deg: float
    lon_deg: float
    alt_m: float


@dataclass(frozen=True, slots=True)
class Origin:
    """GPS_GLOBAL_ORIGIN (49)."""

    lat_deg: float
    lon_deg: float
    alt_m: float


@dataclass(frozen=True, slots=True)
class MessageInterval:
    """MESSAGE_INTERVAL (244): 0 is a message never sent, -1 one that is off."""

    message_id: int
    interval_us: int


@dataclass(frozen=True, slots=True)
class MissionRequestList:
    """MISSION_REQUEST_LIST (43); `kind` is MAV_MISSION_TYPE: mission, fence or rally points."""

    target: Address
    kind: int


@dataclass(frozen=True, slots=True)
class MissionCount:
    """MISSION_COUNT (44)."""

    target: Address
    count: int
    kind: int


@dataclass(frozen=True, slots=True)
class LogRequestList:
    """LOG_REQUEST_LIST (117)."""

    target: Address
    first: int
    last: int


@dataclass(frozen=True, slots=True)
class LogEntry:
    """LOG_ENTRY (118)."""

    id: int
    count: int
    last: int
    t_unix_s: int
    size_bytes: int


@dataclass(frozen=True, slots=True)
class NamedValue:
    """NAMED_VALUE_FLOAT (251); `age_ms` is the age of the newest setpoint at receipt, camera to drone."""

    t_boot_ms: int
    name: str
    value: float


@dataclass(frozen=True, slots=True)
class Unknown:
    """A well-formed packet of a message id that nothing here reads; counted, never an error."""

    message_id: int


LinkMessage = (
    Heartbeat | AttitudeSetpoint | VisionPose | MocapPose | Odometry | Attitude | AttitudeQuaternion | LocalPosition
    | GlobalPosition | HomePosition | SysStatus | Battery | ExtendedSysState | EkfStatus | StatusText | Command
    | CommandInt | CommandAck | SetMode | TimeSync | Ping | SystemTime | ParamValue | ParamSet | ParamRequestRead
    | ParamRequestList | AutopilotVersion | AttitudeTargetReport | SimTruth | NamedValue | PositionSetpoint | SetOrigin
    | Origin | MessageInterval | MissionRequestList | MissionCount | LogRequestList | LogEntry | Unknown
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class Packet:
    """One decoded packet: who sent it, its sequence number, and what it says."""

    source: Address
    seq: int
    message: LinkMessage

"""The messages of one drone's MAVLink link in lab and flu axes, SI units; `wire.mavlink.codec` is their only encoding.

Messages, their enumerations and flags have MAVLink's names. Times that ride on the link are the sender's own clock.
What streams is a named tuple, which costs a third of a frozen dataclass to make; the rare dialogues (commands,
parameters, storage) are dataclasses.
"""

from dataclasses import dataclass
from enum import IntEnum, IntFlag
from typing import NamedTuple

from formation.maths.arrays import Quat, Vec3
from formation.messages import Severity

BROADCAST = 0
GROUND_SYSTEM, GROUND_COMPONENT = 255, 190
DRONE_COMPONENT = 1
BRIDGE_COMPONENT = 191  # MAV_COMP_ID_ONBOARD_COMPUTER


class Address(NamedTuple):
    """A MAVLink system and component."""

    system: int
    component: int

    def __str__(self) -> str:
        return f"{self.system}/{self.component}"

    @property
    def words(self) -> str:
        """The sender's name where it has one, for people."""
        is_ground = self.system == GROUND_SYSTEM and self.component in GROUND_COMPONENTS
        return "the ground" if is_ground else f"system {self}"


GROUND_COMPONENTS = range(25, 100)  # MAV_COMP_ID_USER1 to USER75
GROUND = Address(GROUND_SYSTEM, GROUND_COMPONENT)
EVERYONE = Address(BROADCAST, BROADCAST)


def ground_address(session: int) -> Address:
    """The ground's address in that ground session, the same on every link; a restarted ground has another."""
    return Address(GROUND_SYSTEM, GROUND_COMPONENTS[session % len(GROUND_COMPONENTS)])


class MessageId(IntEnum):
    """MAVLINK_MSG_ID, those that anything here names."""

    HEARTBEAT = 0
    SYS_STATUS = 1
    PING = 4
    SET_MODE = 11
    PARAM_REQUEST_READ = 20
    PARAM_REQUEST_LIST = 21
    PARAM_VALUE = 22
    PARAM_SET = 23
    GPS_RAW_INT = 24
    ATTITUDE = 30
    ATTITUDE_QUATERNION = 31
    LOCAL_POSITION_NED = 32
    GLOBAL_POSITION_INT = 33
    SERVO_OUTPUT_RAW = 36
    MISSION_REQUEST_LIST = 43
    SET_GPS_GLOBAL_ORIGIN = 48
    GPS_GLOBAL_ORIGIN = 49
    VFR_HUD = 74
    COMMAND_INT = 75
    COMMAND_LONG = 76
    COMMAND_ACK = 77
    SET_ATTITUDE_TARGET = 82
    ATTITUDE_TARGET = 83
    SET_POSITION_TARGET_LOCAL_NED = 84
    POSITION_TARGET_LOCAL_NED = 85
    SET_POSITION_TARGET_GLOBAL_INT = 86
    VISION_POSITION_ESTIMATE = 102
    HIGHRES_IMU = 105
    TIMESYNC = 111
    HIL_STATE_QUATERNION = 115
    LOG_REQUEST_LIST = 117
    DISTANCE_SENSOR = 132
    ATT_POS_MOCAP = 138
    ALTITUDE = 141
    BATTERY_STATUS = 147
    AUTOPILOT_VERSION = 148
    EKF_STATUS_REPORT = 193
    ESTIMATOR_STATUS = 230
    HOME_POSITION = 242
    EXTENDED_SYS_STATE = 245
    NAMED_VALUE_FLOAT = 251
    STATUSTEXT = 253
    ODOMETRY = 331


class Ignore(IntFlag):
    """ATTITUDE_TARGET_TYPEMASK."""

    NONE = 0
    ROLL_RATE = 1
    PITCH_RATE = 2
    YAW_RATE = 4
    BODY_RATES = 7
    THRUST = 64
    ATTITUDE = 128


class AttitudeSetpoint(NamedTuple):
    """SET_ATTITUDE_TARGET (82)."""

    target: Address
    t_boot_ms: int
    q_lab_from_flu: Quat
    rate_flu_rad_s: Vec3
    thrust_norm: float
    ignore: Ignore


class AttitudeTargetReport(NamedTuple):
    """ATTITUDE_TARGET (83): what the autopilot is tracking."""

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


class PositionSetpoint(NamedTuple):
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


class VisionPose(NamedTuple):
    """VISION_POSITION_ESTIMATE (102): an external pose for the autopilot's estimator (Euler on the wire)."""

    t_us: int
    pos_lab_m: Vec3
    q_lab_from_flu: Quat


class MocapPose(NamedTuple):
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


class Odometry(NamedTuple):
    """ODOMETRY (331), child frame BODY_FRD; NaN velocity is unknown."""

    t_us: int
    frame: OdometryFrame
    estimator: EstimatorType
    pos_lab_m: Vec3
    q_lab_from_flu: Quat
    vel_flu_m_s: Vec3
    rate_flu_rad_s: Vec3
    reset_counter: int = 0


class Attitude(NamedTuple):
    """ATTITUDE (30) (Euler on the wire)."""

    t_boot_ms: int
    q_lab_from_flu: Quat
    rate_flu_rad_s: Vec3


class AttitudeQuaternion(NamedTuple):
    """ATTITUDE_QUATERNION (31)."""

    t_boot_ms: int
    q_lab_from_flu: Quat
    rate_flu_rad_s: Vec3


class InertialSample(NamedTuple):
    """HIGHRES_IMU (105): what accelerometer and gyroscope showed, in the body's axes (FLU; FRD on the wire).

    t_boot_us: end of the time that the sample is the mean over, on the autopilot's clock, us. Specific force in
    m/s^2, gravity not taken out: +g along up at rest, nothing in free fall. Rate in rad/s, NaN where unknown.
    """

    t_boot_us: int
    specific_force_flu_m_s2: Vec3
    rate_flu_rad_s: Vec3


class LocalPosition(NamedTuple):
    """LOCAL_POSITION_NED (32), in lab axes."""

    t_boot_ms: int
    pos_lab_m: Vec3
    vel_lab_m_s: Vec3


class GlobalPosition(NamedTuple):
    """GLOBAL_POSITION_INT (33); degrees, metres; heading is the yaw about lab z, None where unknown."""

    t_boot_ms: int
    lat_deg: float
    lon_deg: float
    alt_m: float
    height_m: float
    vel_lab_m_s: Vec3
    heading_rad: float | None


class HomePosition(NamedTuple):
    """HOME_POSITION (242)."""

    lat_deg: float
    lon_deg: float
    alt_m: float
    pos_lab_m: Vec3


class SetOrigin(NamedTuple):
    """SET_GPS_GLOBAL_ORIGIN (48): where on the globe the local frame begins."""

    target_system: int
    lat_deg: float
    lon_deg: float
    alt_m: float


class Origin(NamedTuple):
    """GPS_GLOBAL_ORIGIN (49)."""

    lat_deg: float
    lon_deg: float
    alt_m: float


class SimTruth(NamedTuple):
    """HIL_STATE_QUATERNION (115): a simulated autopilot's true state."""

    t_us: int
    q_lab_from_flu: Quat
    vel_lab_m_s: Vec3
    lat_deg: float
    lon_deg: float
    alt_m: float


class ModeFlag(IntFlag):
    """MAV_MODE_FLAG, of Heartbeat.base_mode."""

    CUSTOM_MODE_ENABLED = 1
    AUTO_ENABLED = 4
    GUIDED_ENABLED = 8
    STABILIZE_ENABLED = 16
    MANUAL_INPUT_ENABLED = 64
    SAFETY_ARMED = 128


_ARMED = int(ModeFlag.SAFETY_ARMED)


class MavState(IntEnum):
    """MAV_STATE, of Heartbeat.system_status."""

    UNINIT = 0
    STANDBY = 3
    ACTIVE = 4
    CRITICAL = 5


class MavType(IntEnum):
    """MAV_TYPE, of Heartbeat.vehicle_type."""

    QUADROTOR = 2
    GCS = 6
    ONBOARD_CONTROLLER = 18


class MavAutopilot(IntEnum):
    """MAV_AUTOPILOT, those we speak with."""

    GENERIC = 0
    ARDUPILOT = 3
    INVALID = 8  # a ground station's own heartbeat
    PX4 = 12


class Heartbeat(NamedTuple):
    """HEARTBEAT (0)."""

    autopilot: MavAutopilot
    vehicle_type: int
    base_mode: int
    custom_mode: int
    system_status: int

    @property
    def armed(self) -> bool:
        """Whether its motors may turn."""
        return bool(self.base_mode & _ARMED)


class AutopilotVersion(NamedTuple):
    """AUTOPILOT_VERSION (148)."""

    capabilities: int
    flight_sw_version: int
    uid: int


class SysStatus(NamedTuple):
    """SYS_STATUS (1): sensor bit masks, load 0..1, battery, share of packets lost on the drone's own links."""

    sensors_present: int
    sensors_enabled: int
    sensors_healthy: int
    load: float
    battery_v: float
    battery_a: float
    battery_remaining: float
    drop_rate: float = 0.0


class Battery(NamedTuple):
    """BATTERY_STATUS (147) of the first pack, by which it flies; remaining 0..1."""

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


class ExtendedSysState(NamedTuple):
    """EXTENDED_SYS_STATE (245)."""

    landed: LandedState


class EkfStatus(NamedTuple):
    """EKF_STATUS_REPORT (193, ArduPilot) and ESTIMATOR_STATUS (230, PX4) flags.

    The rest is of ESTIMATOR_STATUS alone: innovation test ratios, above 1 is inconsistent, and RMS errors.
    """

    flags: int
    ardupilot: bool
    t_us: int = 0
    pos_horiz_ratio: float = 0.0
    pos_vert_ratio: float = 0.0
    pos_horiz_accuracy_m: float = 0.0
    pos_vert_accuracy_m: float = 0.0


class ProtocolCapability(IntFlag):
    """MAV_PROTOCOL_CAPABILITY, of AutopilotVersion.capabilities."""

    PARAM_FLOAT = 2
    COMMAND_INT = 8
    PARAM_ENCODE_BYTEWISE = 16
    SET_ATTITUDE_TARGET = 64
    FLIGHT_TERMINATION = 2048
    MAVLINK2 = 8192
    PARAM_ENCODE_C_CAST = 131072


class SensorFlag(IntFlag):
    """MAV_SYS_STATUS_SENSOR, of SysStatus."""

    GYRO_3D = 1 << 0
    ACCEL_3D = 1 << 1
    MAG_3D = 1 << 2
    ABSOLUTE_PRESSURE = 1 << 3
    GPS = 1 << 5
    VISION_POSITION = 1 << 7
    ANGULAR_RATE_CONTROL = 1 << 10
    ATTITUDE_STABILIZATION = 1 << 11
    YAW_POSITION = 1 << 12
    Z_ALTITUDE_CONTROL = 1 << 13
    XY_POSITION_CONTROL = 1 << 14
    MOTOR_OUTPUTS = 1 << 15
    GEOFENCE = 1 << 20
    AHRS = 1 << 21
    BATTERY = 1 << 25
    PREARM_CHECK = 1 << 28


class EstimatorFlag(IntFlag):
    """ESTIMATOR_STATUS_FLAGS; EKF_STATUS_REPORT's mean the same, and there is one more of them."""

    ATTITUDE = 1
    VELOCITY_HORIZ = 2
    VELOCITY_VERT = 4
    POS_HORIZ_REL = 8
    POS_HORIZ_ABS = 16
    POS_VERT_ABS = 32
    POS_VERT_AGL = 64
    CONST_POS_MODE = 128
    PRED_POS_HORIZ_REL = 256
    PRED_POS_HORIZ_ABS = 512
    EKF_UNINITIALIZED = 1024


class StatusText(NamedTuple):
    """STATUSTEXT (253); longer texts are chunked on the wire and joined again."""

    severity: Severity
    text: str


class NamedValue(NamedTuple):
    """NAMED_VALUE_FLOAT (251); `age_ms` is the age of the newest setpoint at receipt, camera to drone."""

    t_boot_ms: int
    name: str
    value: float


class MessageInterval(NamedTuple):
    """MESSAGE_INTERVAL (244): 0 is a message never sent, -1 one that is off."""

    message_id: int
    interval_us: int


class MavCommand(IntEnum):
    """MAV_CMD, those that are sent or obeyed here."""

    NAV_RETURN_TO_LAUNCH = 20
    NAV_LAND = 21
    NAV_TAKEOFF = 22
    DO_SET_MODE = 176
    DO_FLIGHTTERMINATION = 185
    DO_REPOSITION = 192
    MISSION_START = 300
    COMPONENT_ARM_DISARM = 400
    GET_HOME_POSITION = 410
    GET_MESSAGE_INTERVAL = 510
    SET_MESSAGE_INTERVAL = 511
    REQUEST_MESSAGE = 512
    REQUEST_AUTOPILOT_CAPABILITIES = 520
    REQUEST_OPERATOR_CONTROL = 32100
    """development.xml; parameter 1: the system, 2: 1 request, 0 release."""


class MavFrame(IntEnum):
    """MAV_FRAME, of CommandInt."""

    GLOBAL = 0
    LOCAL_NED = 1
    MISSION = 2
    GLOBAL_RELATIVE_ALT = 3
    LOCAL_ENU = 4
    GLOBAL_INT = 5
    GLOBAL_RELATIVE_ALT_INT = 6
    LOCAL_OFFSET_NED = 7
    BODY_NED = 8
    BODY_OFFSET_NED = 9
    GLOBAL_TERRAIN_ALT = 10
    GLOBAL_TERRAIN_ALT_INT = 11
    BODY_FRD = 12
    LOCAL_FRD = 20
    LOCAL_FLU = 21


DISARM_IN_FLIGHT, ARM_PAST_CHECKS = 21196, 2989
"""COMPONENT_ARM_DISARM's second parameter: what forces it, in both autopilots."""


@dataclass(frozen=True, slots=True)
class CommandLong:
    """COMMAND_LONG (76)."""

    target: Address
    command: int
    params: tuple[float, float, float, float, float, float, float]
    confirmation: int = 0


def command_long(target: Address, command: int, *params: float) -> CommandLong:
    """The command with zeros for the parameters that are not given."""
    p1, p2, p3, p4, p5, p6, p7 = (*params, *(0.0,) * (7 - len(params)))
    return CommandLong(target, command, (p1, p2, p3, p4, p5, p6, p7))


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


class TimeSync(NamedTuple):
    """TIMESYNC (111): ts1 is the sender's stamp, tc1 zero in a request."""

    tc1_ns: int
    ts1_ns: int
    target: Address = EVERYONE


class Ping(NamedTuple):
    """PING (4)."""

    t_us: int
    seq: int
    target: Address


class SystemTime(NamedTuple):
    """SYSTEM_TIME (2)."""

    t_unix_us: int
    t_boot_ms: int


class UnknownMessage(NamedTuple):
    """A well-formed packet of a message id that nothing here reads; counted, never an error."""

    message_id: int


LinkMessage = (
    Heartbeat | AttitudeSetpoint | VisionPose | MocapPose | Odometry | Attitude | AttitudeQuaternion | LocalPosition
    | GlobalPosition | HomePosition | SysStatus | Battery | ExtendedSysState | EkfStatus | StatusText | CommandLong
    | CommandInt | CommandAck | SetMode | TimeSync | Ping | SystemTime | ParamValue | ParamSet | ParamRequestRead
    | ParamRequestList | AutopilotVersion | AttitudeTargetReport | SimTruth | NamedValue | PositionSetpoint | SetOrigin
    | Origin | MessageInterval | MissionRequestList | MissionCount | LogRequestList | LogEntry | InertialSample
    | UnknownMessage
)  # fmt: skip


class Packet(NamedTuple):
    """One decoded packet: who sent it, its sequence number, and what it says."""

    source: Address
    seq: int
    message: LinkMessage

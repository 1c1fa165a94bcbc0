"""What an autopilot says of itself: who it is, how it does, what it has to say."""

from enum import IntEnum, IntFlag
from typing import NamedTuple

from formation.messages import Severity


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
    """SYS_STATUS (1): sensor bit masks, load 0..1, battery."""

    sensors_present: int
    sensors_enabled: int
    sensors_healthy: int
    load: float
    battery_v: float
    battery_a: float
    battery_remaining: float


class Battery(NamedTuple):
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

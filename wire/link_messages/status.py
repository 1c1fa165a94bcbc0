"""What an autopilot says of itself: who it is, how it does, what it has to say."""

from enum import IntEnum
from typing import NamedTuple

from formation.messages import Severity

ARMED = 128
"""Of Heartbeat.base_mode: MAV_MODE_FLAG_SAFETY_ARMED."""


class Autopilot(IntEnum):
    """MAV_AUTOPILOT, those we speak with."""

    GENERIC = 0
    ARDUPILOT = 3
    INVALID = 8  # a ground station's own heartbeat
    PX4 = 12


class Heartbeat(NamedTuple):
    """HEARTBEAT (0)."""

    autopilot: Autopilot
    vehicle_type: int
    base_mode: int
    custom_mode: int
    system_status: int

    @property
    def armed(self) -> bool:
        """Whether its motors may turn."""
        return bool(self.base_mode & ARMED)


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
    """EKF_STATUS_REPORT (193, ArduPilot) and ESTIMATOR_STATUS (230, PX4) flags."""

    flags: int
    ardupilot: bool


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

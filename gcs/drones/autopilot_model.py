"""The ground's demands on each autopilot, as data: off-board mode, parameters, streams, setpoint fields that it reads.

Built on wire.autopilots' tables; a drone's heartbeat says which applies. Everything else is one code for all.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

from formation.config import LabConfig
from formation.vehicle.profile import VehicleProfile
from gcs.drones.telemetry import Telemetry
from wire.autopilots.ardupilot import ARDUPILOT, THRUST_AS_THRUST
from wire.autopilots.crazyflie import CRAZYFLIE
from wire.autopilots.px4 import PX4
from wire.autopilots.table import AutopilotTable, FlightMode
from wire.link_messages import (
    Address,
    CommandLong,
    EstimatorFlag,
    Ignore,
    MavAutopilot,
    MavCommand,
    MessageId,
    ModeFlag,
    SensorFlag,
    command_long,
)

HOVER_WITHIN = 0.15
"""Share by which an autopilot's own hover thrust may differ from the profile's before the ground warns."""
IDLE_DISARM_LEAST_S = 8.0  # arming a swarm takes three seconds, a take-off three more, the operator what is left


@dataclass(frozen=True, slots=True)
class ParameterRule:
    """A parameter's value that a flight needs, and why; `set_to` is what `gcs doctor --fix` writes.

    vital: without it our setpoints would be misread or not die in time, so arming is refused, but for a value that it
    tolerates.
    external_pose: without it the drone does not fly by the poses that it is sent: a fault of the doctor.
    """

    name: str
    wanted: str
    holds: Callable[[float], bool]
    why: str
    set_to: float
    vital: bool = False
    external_pose: bool = False
    tolerates: Callable[[float], bool] = lambda _: False

    def rejects(self, found: float | None) -> bool:
        """Whether the ground refuses to arm a drone with this value, None where it could not be read."""
        return self.vital and (found is None or not (self.holds(found) or self.tolerates(found)))


@dataclass(frozen=True, slots=True)
class GroundModel:
    """One autopilot as the ground deals with it."""

    table: AutopilotTable
    ignore: Ignore
    """Body rates that it does not accept beside an attitude."""
    rules: tuple[ParameterRule, ...]
    streams: tuple[tuple[int, float], ...]
    """Messages to ask for: id and rate, Hz."""
    unread: tuple[int, ...]
    """Messages that it sends unasked and that nobody here reads: switched off on a link of our own."""
    unready: Callable[[Telemetry], str]
    """Why its estimator cannot carry a flight yet; empty when it can, or does not say."""

    @property
    def name(self) -> str:
        """As operators know it."""
        return self.table.name

    def hover_measured(self, hover_norm: float) -> bool:
        """Whether flying taught it this value of its hover thrust; the default says nothing of a vehicle."""
        is_default = abs(hover_norm - self.table.default(self.table.hover_parameter)) <= 1e-6
        return 0.05 < hover_norm < 0.95 and not is_default

    @property
    def idle_disarm_default_s(self) -> float:
        """After how long it disarms when armed without a take-off, unless it says otherwise."""
        return self.table.default(self.table.idle_disarm_parameter)

    @property
    def parameters(self) -> tuple[str, ...]:
        """The names to read before arming."""
        return (*(rule.name for rule in self.rules), self.table.hover_parameter)

    def set_offboard(self, target: Address) -> CommandLong:
        """Follow our setpoints."""
        mode = self.table.modes[FlightMode.OFFBOARD]
        flags = (ModeFlag.CUSTOM_MODE_ENABLED, mode.main, mode.sub)
        return command_long(target, MavCommand.DO_SET_MODE, *map(float, flags))

    def setpoint_ignore(self, profile: VehicleProfile) -> Ignore:
        """The type mask of SET_ATTITUDE_TARGET: a vehicle known to feed all body rates forward is given them all."""
        return Ignore.NONE if profile.rate_feed_forward else self.ignore


_PX4_NEEDS = {
    SensorFlag.GYRO_3D: "healthy gyroscope",
    SensorFlag.ACCEL_3D: "healthy accelerometer",
    SensorFlag.AHRS: "valid attitude estimate",
    SensorFlag.XY_POSITION_CONTROL: "valid position estimate",
}


def _px4_unready(telemetry: Telemetry) -> str:
    """The lacks in PX4's health report that forbid any flight of ours; it reports its others when it is armed."""
    lacks = telemetry.sensors_unhealthy
    return ", ".join(f"PX4 reports no {name}" for bit, name in _PX4_NEEDS.items() if lacks & bit)


def _copter_unready(telemetry: Telemetry) -> str:
    status = telemetry.estimator
    if status is None:
        return "no estimator report yet"
    uninitialised = status.flags & EstimatorFlag.EKF_UNINITIALIZED
    ready = status.flags & EstimatorFlag.POS_HORIZ_ABS and not uninitialised
    return "" if ready else "estimator has no position yet"


def _crazyflie_unready(telemetry: Telemetry) -> str:
    lacks = telemetry.sensors_unhealthy
    return "the Crazyflie reports no estimate that agrees with the mocap" if lacks & SensorFlag.VISION_POSITION else ""


def _is(value: float) -> Callable[[float], bool]:
    return lambda found: found == value


def _has(bits: int) -> Callable[[float], bool]:
    return lambda found: int(found) & bits == bits


def _between(low: float, high: float) -> Callable[[float], bool]:
    return lambda found: low <= found <= high


def _rule(
    table: AutopilotTable, name: str, wanted: str, holds: Callable[[float], bool], why: str,
    *, vital: bool = False, external_pose: bool = False, tolerates: Callable[[float], bool] = lambda _: False,
) -> ParameterRule:  # fmt: skip
    """A rule about a parameter of the table; where nothing is said, it is set to what a lab's drone has."""
    value = table.indoor.get(name, table.default(name))
    return ParameterRule(name, wanted, holds, why, value, vital, external_pose, tolerates)


def _idle_disarm_rule(table: AutopilotTable) -> ParameterRule:
    wanted = f"{IDLE_DISARM_LEAST_S:g} s or more, or 0 (never)"
    why = "disarms an armed drone before all can take off"
    return _rule(
        table, table.idle_disarm_parameter, wanted, lambda found: found <= 0.0 or found >= IDLE_DISARM_LEAST_S, why
    )


PX4_MODEL = GroundModel(
    table=PX4,
    # With both given, PX4 publishes a rate setpoint beside the attitude's own; it takes the yaw rate alone.
    ignore=Ignore.ROLL_RATE | Ignore.PITCH_RATE,
    rules=(
        _idle_disarm_rule(PX4),
        _rule(
            PX4, "COM_OF_LOSS_T", "0.1 to 0.2 s", _between(0.1, 0.201),
            "how long it flies on after our setpoints stop", vital=True, tolerates=_between(0.0, 2.0),
        ),
        _rule(
            PX4, "COM_OBL_RC_ACT", "4 (land)", _is(4.0), "what it does when our setpoints stop",
        ),
        _rule(
            PX4, "CBRK_FLIGHTTERM", "0 (on)", _is(0.0), "motors off where it lies on its side for 0.3 s",
        ),
        _rule(
            PX4, "EKF2_EV_CTRL", "position, height and yaw (11)", _has(11), "fuses the mocap pose",
            external_pose=True,
        ),
        _rule(
            PX4, "EKF2_HGT_REF", "3 (vision)", _is(3.0), "takes height from the mocap", external_pose=True,
        ),
        _rule(
            PX4, "EKF2_EVP_NOISE", "at most 0.02 m", _between(0.0, 0.02),
            "trusts the mocap: with 0.1 m its estimate wandered by decimetres", external_pose=True,
        ),
        _rule(
            PX4, "EKF2_GPS_CTRL", "0 (none)", _is(0.0), "GPS indoors pulls the estimate away", external_pose=True,
        ),
        _rule(
            PX4, "EKF2_MAG_TYPE", "5 (none)", _is(5.0), "iron indoors turns the heading", external_pose=True,
        ),
        _rule(
            PX4, "COM_RCL_EXCEPT", "off-board (bit 4)", _has(4), "no remote control is no failsafe in off-board",
        ),
    ),
    streams=(
        (MessageId.ATTITUDE_QUATERNION, 50.0),
        (MessageId.EXTENDED_SYS_STATE, 2.0),
        (MessageId.BATTERY_STATUS, 1.0),
    ),
    # Nine tenths of PX4's off-board link.
    unread=(
        MessageId.ATTITUDE,
        MessageId.GLOBAL_POSITION_INT,
        MessageId.ATTITUDE_TARGET,
        MessageId.HIGHRES_IMU,
        MessageId.ODOMETRY,
        MessageId.ALTITUDE,
        MessageId.VFR_HUD,
        MessageId.SERVO_OUTPUT_RAW,
        MessageId.POSITION_TARGET_LOCAL_NED,
        MessageId.DISTANCE_SENSOR,
        MessageId.GPS_RAW_INT,
    ),
    unready=_px4_unready,
)  # fmt: skip

ARDUPILOT_MODEL = GroundModel(
    table=ARDUPILOT,
    ignore=Ignore.NONE,
    rules=(
        _idle_disarm_rule(ARDUPILOT),
        _rule(
            ARDUPILOT, "GUID_OPTIONS", "thrust (bit 8)", _has(THRUST_AS_THRUST),
            "without it our thrust is read as a climb rate", vital=True,
        ),
        _rule(
            ARDUPILOT, "GUID_TIMEOUT", "0.1 to 1 s", _between(0.1, 1.0),
            "how long it flies on after our setpoints stop", vital=True,
        ),
        _rule(ARDUPILOT, "FS_GCS_ENABLE", "5 (land)", _is(5.0), "what it does when the ground's heartbeat stops"),
        _rule(ARDUPILOT, "VISO_TYPE", "1 (MAVLink)", _is(1.0), "takes the mocap pose", external_pose=True),
        _rule(
            ARDUPILOT, "EK3_SRC1_POSXY", "6 (external)", _is(6.0), "takes position from the mocap", external_pose=True,
        ),
        _rule(
            ARDUPILOT, "EK3_SRC1_POSZ", "6 (external)", _is(6.0), "takes height from the mocap", external_pose=True,
        ),
        _rule(
            ARDUPILOT, "EK3_SRC1_VELXY", "0 (none)", _is(0.0), "a GPS that is not there keeps it from arming",
            external_pose=True,
        ),
        _rule(
            ARDUPILOT, "EK3_SRC1_VELZ", "0 (none)", _is(0.0), "a GPS that is not there keeps it from arming",
            external_pose=True,
        ),
        _rule(
            ARDUPILOT, "EK3_SRC1_YAW", "6 (external)", _is(6.0), "iron indoors turns the heading", external_pose=True,
        ),
    ),
    streams=(
        (MessageId.ATTITUDE_QUATERNION, 50.0),
        (MessageId.LOCAL_POSITION_NED, 30.0),
        (MessageId.EXTENDED_SYS_STATE, 2.0),
        (MessageId.BATTERY_STATUS, 1.0),
        (MessageId.EKF_STATUS_REPORT, 2.0),
        (MessageId.SYS_STATUS, 1.0),
    ),
    unread=(),
    unready=_copter_unready,
)  # fmt: skip

CRAZYFLIE_MODEL = GroundModel(
    table=CRAZYFLIE,
    ignore=Ignore.BODY_RATES,
    rules=(
        _idle_disarm_rule(CRAZYFLIE),
        _rule(CRAZYFLIE, "CF_ESTIMATOR", "2 (Kalman)", _is(2.0), "fuses the mocap pose", external_pose=True),
        _rule(CRAZYFLIE, "CF_CONTROLLER", "1 (PID)", _is(1.0), "the attitude loop that was flown and identified"),
        _rule(
            CRAZYFLIE, "CF_POS_STD", "0.001 to 0.02 m", _between(0.001, 0.02), "how far it trusts the mocap's position",
            external_pose=True,
        ),
        _rule(
            CRAZYFLIE, "CF_ATT_STD", "0.001 to 0.05", _between(0.001, 0.05), "how far it trusts the mocap's attitude",
            external_pose=True,
        ),
    ),
    streams=PX4_MODEL.streams,
    unread=(),
    unready=_crazyflie_unready,
)  # fmt: skip

GROUND_MODELS: Mapping[MavAutopilot, GroundModel] = MappingProxyType(
    {model.table.autopilot: model for model in (PX4_MODEL, ARDUPILOT_MODEL, CRAZYFLIE_MODEL)}
)


def streams(config: LabConfig) -> tuple[tuple[int, float], ...]:
    """The messages to ask each drone for beside its model's, id and rate, Hz: its accelerometer's, where wanted."""
    return ((int(MessageId.HIGHRES_IMU), config.link.imu_rate_hz),) if config.link.imu_rate_hz > 0.0 else ()

"""The agent's telemetry: one builder for each message id it can send."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from drone_agent.autopilots.model import Task
from drone_agent.config import AutopilotConfig
from drone_agent.flight.autopilot import Autopilot
from formation.maths.arrays import Vec3
from formation.maths.geodesy import to_globe
from wire.link_messages import (
    Attitude,
    AttitudeQuaternion,
    AttitudeTargetReport,
    AutopilotVersion,
    Battery,
    EkfStatus,
    ExtendedSysState,
    GlobalPosition,
    Heartbeat,
    HomePosition,
    Ignore,
    InertialSample,
    LandedState,
    LinkMessage,
    LocalPosition,
    MavAutopilot,
    MavType,
    MessageId,
    ModeFlag,
    Origin,
    SensorFlag,
    SysStatus,
    TimeSync,
)

_SENSORS = SensorFlag.GYRO_3D | SensorFlag.ACCEL_3D | SensorFlag.MAG_3D | SensorFlag.ABSOLUTE_PRESSURE
_CONTROL = (
    SensorFlag.ANGULAR_RATE_CONTROL
    | SensorFlag.ATTITUDE_STABILIZATION
    | SensorFlag.YAW_POSITION
    | SensorFlag.Z_ALTITUDE_CONTROL
    | SensorFlag.XY_POSITION_CONTROL
    | SensorFlag.MOTOR_OUTPUTS
)
_PRESENT = _SENSORS | _CONTROL | SensorFlag.AHRS | SensorFlag.BATTERY | SensorFlag.PREARM_CHECK


@dataclass(frozen=True, slots=True)
class Telemetry:
    """What telemetry is made of; what makes it of this, at a time, is in BUILDERS."""

    config: AutopilotConfig
    autopilot: Autopilot
    t0_ns: int

    def boot_ms(self, now_ns: int) -> int:
        """Time since boot, ms."""
        return (now_ns - self.t0_ns) // 1_000_000


def _heartbeat(t: Telemetry, now_ns: int) -> LinkMessage:
    pilot = t.autopilot
    model = pilot.model
    ready = pilot.armed or pilot.arming_fault(now_ns) is None
    status = model.system_status(pilot.armed, pilot.landed, pilot.failsafe, ready)
    base_mode = pilot.row.flags | (ModeFlag.SAFETY_ARMED if pilot.armed else 0)
    return Heartbeat(model.table.autopilot, MavType.QUADROTOR, base_mode, pilot.row.custom_mode, status)


def _sys_status(t: Telemetry, now_ns: int) -> LinkMessage:
    pilot = t.autopilot
    receiver = SensorFlag.VISION_POSITION if t.config.pose == "mocap" else SensorFlag.GPS
    present = _PRESENT | receiver
    healthy = present
    if not pilot.estimator.valid(now_ns):
        healthy &= ~receiver
    if not pilot.armed and pilot.arming_fault(now_ns) is not None:
        healthy &= ~SensorFlag.PREARM_CHECK
    enabled, fence = present, pilot.model.fence_parameter
    if fence is not None:  # there, and not breached
        present, healthy = present | SensorFlag.GEOFENCE, healthy | SensorFlag.GEOFENCE
        enabled |= SensorFlag.GEOFENCE if pilot.parameters[fence] else 0
    pack, loss = pilot.vehicle.pack, pilot.vehicle.link_loss
    return SysStatus(present, enabled, healthy, 0.2, pack.voltage_v, pack.current_a, pack.remaining, loss)


def _attitude(t: Telemetry, _now_ns: int) -> LinkMessage:
    estimate = t.autopilot.estimator
    return Attitude(t.boot_ms(estimate.t_ns), estimate.q_lab_from_flu, estimate.rate_flu_rad_s)


def _attitude_quaternion(t: Telemetry, _now_ns: int) -> LinkMessage:
    estimate = t.autopilot.estimator
    return AttitudeQuaternion(t.boot_ms(estimate.t_ns), estimate.q_lab_from_flu, estimate.rate_flu_rad_s)


def _inertial(t: Telemetry, _now_ns: int) -> LinkMessage | None:
    sample = t.autopilot.vehicle.newest_sample
    if sample is None:
        return None
    return InertialSample((sample.t_ns - t.t0_ns) // 1000, sample.specific_force_flu_m_s2, sample.rate_flu_rad_s)


def _local_position(t: Telemetry, now_ns: int) -> LinkMessage | None:
    pilot = t.autopilot
    if not pilot.estimator.valid(now_ns):
        return None
    estimate = pilot.estimator
    return LocalPosition(t.boot_ms(estimate.t_ns), estimate.pos_lab_m, estimate.vel_lab_m_s)


def _global_position(t: Telemetry, now_ns: int) -> LinkMessage | None:
    pilot = t.autopilot
    if pilot.origin is None or not pilot.estimator.valid(now_ns):
        return None
    belief = pilot.belief
    lat, lon, alt = to_globe(pilot.origin, belief.pos_lab_m)
    ground_m = pilot.home.pos_lab_m[2] if pilot.home else t.config.start_lab_m[2]
    vel: Vec3 = np.array(belief.vel_lab_m_s)
    return GlobalPosition(t.boot_ms(now_ns), lat, lon, alt, belief.pos_lab_m[2] - ground_m, vel, belief.yaw_rad)


def _home(t: Telemetry, now_ns: int) -> LinkMessage | None:
    pilot = t.autopilot
    if pilot.origin is None or not pilot.estimator.valid(now_ns):
        return None
    home_lab_m = pilot.home.pos_lab_m if pilot.home else t.config.start_lab_m
    lat, lon, alt = to_globe(pilot.origin, home_lab_m)
    return HomePosition(lat, lon, alt, np.array(home_lab_m))


def _battery(t: Telemetry, _now_ns: int) -> LinkMessage:
    pack = t.autopilot.vehicle.pack
    return Battery((pack.cell_v,) * pack.cells, pack.current_a, pack.used_mah, pack.remaining)


def _extended(t: Telemetry, _now_ns: int) -> LinkMessage:
    pilot = t.autopilot
    if pilot.landed:
        return ExtendedSysState(LandedState.ON_GROUND)
    landing = pilot.task in (Task.LAND, Task.DESCEND)
    rising = LandedState.TAKEOFF if pilot.task is Task.TAKEOFF else LandedState.IN_AIR
    return ExtendedSysState(LandedState.LANDING if landing else rising)


def _estimator(t: Telemetry, now_ns: int) -> LinkMessage:
    pilot = t.autopilot
    placed = pilot.origin is not None or not pilot.model.table.needs_origin
    valid = placed and pilot.estimator.valid(now_ns)
    flags = pilot.model.estimator_flags(valid, pilot.position_fault(now_ns) is None)
    return EkfStatus(flags, t.autopilot.model.table.autopilot is MavAutopilot.ARDUPILOT)


def _target(t: Telemetry, now_ns: int) -> LinkMessage:
    now = t.autopilot.vehicle.setpoint
    return AttitudeTargetReport(t.boot_ms(now_ns), now.q_lab_from_flu, now.rate_flu_rad_s, now.thrust_norm, Ignore.NONE)


def _timesync(t: Telemetry, now_ns: int) -> LinkMessage:
    return TimeSync(0, now_ns - t.t0_ns)


def _origin(t: Telemetry, _now_ns: int) -> LinkMessage | None:
    return None if t.autopilot.origin is None else Origin(*t.autopilot.origin)


def _version(t: Telemetry, _now_ns: int) -> LinkMessage:
    model = t.autopilot.model
    return AutopilotVersion(model.capabilities, model.version, t.config.sysid)


BUILDERS: dict[int, Callable[[Telemetry, int], LinkMessage | None]] = {
    MessageId.HEARTBEAT: _heartbeat,
    MessageId.SYS_STATUS: _sys_status,
    MessageId.ATTITUDE: _attitude,
    MessageId.ATTITUDE_QUATERNION: _attitude_quaternion,
    MessageId.HIGHRES_IMU: _inertial,
    MessageId.LOCAL_POSITION_NED: _local_position,
    MessageId.GLOBAL_POSITION_INT: _global_position,
    MessageId.GPS_GLOBAL_ORIGIN: _origin,
    MessageId.ATTITUDE_TARGET: _target,
    MessageId.TIMESYNC: _timesync,
    MessageId.BATTERY_STATUS: _battery,
    MessageId.AUTOPILOT_VERSION: _version,
    MessageId.EKF_STATUS_REPORT: _estimator,
    MessageId.ESTIMATOR_STATUS: _estimator,
    MessageId.HOME_POSITION: _home,
    MessageId.EXTENDED_SYS_STATE: _extended,
}
"""By message id; None: there is none to send now."""
ON_REQUEST = frozenset({MessageId.GPS_GLOBAL_ORIGIN, MessageId.AUTOPILOT_VERSION})
"""Sent when asked for, never at a rate."""

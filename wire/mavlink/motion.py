"""Messages of motion, poses and setpoints to and from MAVLink fields (in the order of its documentation).

MAVLink's world is north-east-down and its body forward-right-down. Lab x is north and lab y is west: both turns are
diag(1, -1, -1), their own inverse. Quaternions are `w, x, y, z`. Scalars in, scalars out: these run for every packet.

A writer returns the layout and its fields, a reader takes the fields. Positions and attitudes must be finite;
velocities and rates may be NaN, MAVLink's "unknown".
"""

import math
from collections.abc import Callable, Mapping
from functools import lru_cache
from typing import Any

import numpy as np

from formation.maths.arrays import Quat, Vec3
from formation.maths.frames import IDENTITY
from wire.link_messages import (
    Address,
    Attitude,
    AttitudeQuaternion,
    AttitudeSetpoint,
    AttitudeTargetReport,
    EstimatorType,
    GlobalPosition,
    HomePosition,
    Ignore,
    InertialSample,
    LocalPosition,
    MocapPose,
    Odometry,
    OdometryFrame,
    SimTruth,
    Unknown,
    VisionPose,
)
from wire.mavlink.framing import Fields, Layout, MavlinkError, layout

Triple = tuple[float, float, float]
Quadruple = tuple[float, float, float, float]

# Nearer to +-90 degrees of pitch than this (sine of the pitch), only roll plus yaw is observable: roll is set to 0.
POLE = 1.0 - 1e-12


def ned(vector_lab: Vec3) -> Triple:
    """v_ned of v_lab, and v_frd of v_flu (never a negative zero, which would cost bytes on the wire)."""
    x, y, z = vector_lab.tolist()
    return x, 0.0 - y, 0.0 - z


def lab(x: float, y: float, z: float) -> Vec3:
    """v_lab of v_ned, and v_flu of v_frd; NaN stays NaN."""
    return np.array((x, 0.0 - y, 0.0 - z))


def lab_finite(x: float, y: float, z: float) -> Vec3:
    """v_lab of v_ned; MavlinkError unless it is finite."""
    if not math.isfinite(x + y + z):
        raise MavlinkError("not a finite vector")
    return np.array((x, 0.0 - y, 0.0 - z))


def q_ned_from_frd(q_lab_from_flu: Quat) -> Quadruple:
    """q_ned_from_frd of q_lab_from_flu."""
    w, x, y, z = q_lab_from_flu.tolist()
    return w, x, 0.0 - y, 0.0 - z


def q_lab_from_flu(w: float, x: float, y: float, z: float) -> Quat:
    """q_lab_from_flu, unit and w >= 0, of any q_ned_from_frd; MavlinkError if it is no rotation."""
    norm = math.sqrt(w * w + x * x + y * y + z * z)
    if not 1e-3 < norm < 1e3:
        raise MavlinkError("not a quaternion of a rotation")
    scale = (-1.0 if w < 0.0 else 1.0) / norm
    return np.array((w * scale, x * scale, 0.0 - y * scale, 0.0 - z * scale))


def euler_ned_from_frd(q: Quat) -> Triple:
    """Roll, pitch, yaw (intrinsic z-y-x, rad) of the body FRD in NED, from q_lab_from_flu."""
    w, x, y, z = q_ned_from_frd(q)
    sin_pitch = 2.0 * (w * y - z * x)
    if abs(sin_pitch) > POLE:
        side = math.copysign(1.0, sin_pitch)
        return 0.0, side * 0.5 * math.pi, _exact(-2.0 * side * math.atan2(x, w))
    roll = math.atan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))
    yaw = math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
    return _exact(roll), _exact(math.asin(sin_pitch)), _exact(yaw)


def _exact(angle: float) -> float:
    """Zero for what is only the rounding of zero: a level drone is sent as level, and zeros cost no bytes."""
    return 0.0 if -1e-12 < angle < 1e-12 else angle


def q_lab_from_euler(roll: float, pitch: float, yaw: float) -> Quat:
    """q_lab_from_flu of roll, pitch, yaw of the body FRD in NED; MavlinkError unless finite."""
    if not math.isfinite(roll + pitch + yaw):
        raise MavlinkError("not a finite attitude")
    cr, sr = math.cos(0.5 * roll), math.sin(0.5 * roll)
    cp, sp = math.cos(0.5 * pitch), math.sin(0.5 * pitch)
    cy, sy = math.cos(0.5 * yaw), math.sin(0.5 * yaw)
    return q_lab_from_flu(
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    )


def heading_ned(heading_lab_rad: float) -> float:
    """Compass heading (clockwise from north, rad, 0..2 pi) of a heading about lab z, or the reverse turn."""
    return (-heading_lab_rad) % (2.0 * math.pi)


Written = tuple[Layout, Fields]

SET_ATTITUDE_TARGET = layout("SET_ATTITUDE_TARGET", 12)
ATTITUDE_TARGET = layout("ATTITUDE_TARGET", 10)
VISION_POSITION_ESTIMATE = layout("VISION_POSITION_ESTIMATE", 29)
ATT_POS_MOCAP = layout("ATT_POS_MOCAP", 29)
ODOMETRY = layout("ODOMETRY", 61)
ATTITUDE = layout("ATTITUDE", 7)
ATTITUDE_QUATERNION = layout("ATTITUDE_QUATERNION", 12)
HIGHRES_IMU = layout("HIGHRES_IMU", 15)  # without the number of the sensor: autopilots send the one they fly by
LOCAL_POSITION_NED = layout("LOCAL_POSITION_NED", 7)
GLOBAL_POSITION_INT = layout("GLOBAL_POSITION_INT", 9)
HOME_POSITION = layout("HOME_POSITION", 14)
HIL_STATE_QUATERNION = layout("HIL_STATE_QUATERNION", 19)
SIM_STATE = layout("SIM_STATE", 23)

# A covariance whose first element is NaN is unknown, says MAVLink; the rest stays zero and costs no bytes.
UNKNOWN_COVARIANCE = (math.nan, *(0.0,) * 20)
_BODY_FRD = 12
_HEADING_UNKNOWN = 65535
_MS_32 = 0xFFFFFFFF
_MOST_16, _MOST_32 = 2**15 - 1, 2**31 - 1
_ACCELEROMETER, _GYROSCOPE = 0x07, 0x38  # of HIGHRES_IMU_UPDATED_FLAGS
_ignore = lru_cache(maxsize=256)(Ignore)
_NO_ATTITUDE, _NO_THRUST = int(Ignore.ATTITUDE), int(Ignore.THRUST)  # plain, for every packet


def _write_setpoint(m: AttitudeSetpoint) -> Written:
    target = m.target
    rate = ned(m.rate_flu_rad_s)
    q = q_ned_from_frd(m.q_lab_from_flu)
    return SET_ATTITUDE_TARGET, (
        m.t_boot_ms & _MS_32, target.system, target.component, int(m.ignore), *q, *rate, m.thrust_norm,
    )  # fmt: skip


def _read_setpoint(f: Fields) -> AttitudeSetpoint:
    t_boot_ms, system, component, mask, w, x, y, z, p, q, r, thrust = f
    attitude, rate, thrust = _demand(mask, (w, x, y, z), (p, q, r), thrust)
    return AttitudeSetpoint(Address(system, component), t_boot_ms, attitude, lab(*rate), thrust, _ignore(mask))


def _write_attitude_target(m: AttitudeTargetReport) -> Written:
    q, rate = q_ned_from_frd(m.q_lab_from_flu), ned(m.rate_flu_rad_s)
    return ATTITUDE_TARGET, (m.t_boot_ms & _MS_32, int(m.ignore), *q, *rate, m.thrust_norm)


def _read_attitude_target(f: Fields) -> AttitudeTargetReport:
    t_boot_ms, mask, w, x, y, z, p, q, r, thrust = f
    attitude, rate, thrust = _demand(mask, (w, x, y, z), (p, q, r), thrust)
    return AttitudeTargetReport(t_boot_ms, attitude, lab(*rate), thrust, _ignore(mask))


def _demand(
    mask: int, q: tuple[float, float, float, float], rate: tuple[float, float, float], thrust: float
) -> tuple[Quat, tuple[float, float, float], float]:
    """What a setpoint asks for: an ignored part reads as identity or zero, one that counts must be finite."""
    attitude = IDENTITY.copy() if mask & _NO_ATTITUDE else q_lab_from_flu(*q)
    p, q_, r = rate
    rate = (0.0 if mask & 1 else p, 0.0 if mask & 2 else q_, 0.0 if mask & 4 else r)
    if mask & _NO_THRUST:
        thrust = 0.0
    if not math.isfinite(rate[0] + rate[1] + rate[2] + thrust):
        raise MavlinkError("a setpoint that is not finite")
    return attitude, rate, thrust


def _write_vision(m: VisionPose) -> Written:
    euler = euler_ned_from_frd(m.q_lab_from_flu)
    return VISION_POSITION_ESTIMATE, (m.t_us, *ned(m.pos_lab_m), *euler, *UNKNOWN_COVARIANCE, 0)


def _read_vision(f: Fields) -> VisionPose:
    return VisionPose(f[0], lab_finite(*f[1:4]), q_lab_from_euler(*f[4:7]))


def _write_mocap(m: MocapPose) -> Written:
    return ATT_POS_MOCAP, (m.t_us, *q_ned_from_frd(m.q_lab_from_flu), *ned(m.pos_lab_m), *UNKNOWN_COVARIANCE)


def _read_mocap(f: Fields) -> MocapPose:
    return MocapPose(f[0], lab_finite(*f[5:8]), q_lab_from_flu(*f[1:5]))


def _write_odometry(m: Odometry) -> Written:
    velocity, rate = ned(m.vel_flu_m_s), ned(m.rate_flu_rad_s)
    pose = (*ned(m.pos_lab_m), *q_ned_from_frd(m.q_lab_from_flu))
    covariances = (*UNKNOWN_COVARIANCE, *UNKNOWN_COVARIANCE)
    head = (m.t_us, int(m.frame), _BODY_FRD)
    return ODOMETRY, (*head, *pose, *velocity, *rate, *covariances, m.reset_counter, int(m.estimator), 0)


def _read_odometry(f: Fields) -> Odometry | Unknown:
    """Unknown where the velocity is not in BODY_FRD, as in PX4's own telemetry: nobody here reads that."""
    if f[2] != _BODY_FRD:
        return Unknown(ODOMETRY.id)
    return Odometry(
        t_us=f[0],
        frame=OdometryFrame(f[1]),
        estimator=EstimatorType(f[59]),
        pos_lab_m=lab_finite(*f[3:6]),
        q_lab_from_flu=q_lab_from_flu(*f[6:10]),
        vel_flu_m_s=lab(*f[10:13]),
        rate_flu_rad_s=lab(*f[13:16]),
        reset_counter=f[58],
    )


def _write_attitude(m: Attitude) -> Written:
    return ATTITUDE, (m.t_boot_ms & _MS_32, *euler_ned_from_frd(m.q_lab_from_flu), *ned(m.rate_flu_rad_s))


def _read_attitude(f: Fields) -> Attitude:
    return Attitude(f[0], q_lab_from_euler(*f[1:4]), lab(*f[4:7]))


def _write_attitude_quaternion(m: AttitudeQuaternion) -> Written:
    q, rate = q_ned_from_frd(m.q_lab_from_flu), ned(m.rate_flu_rad_s)
    return ATTITUDE_QUATERNION, (m.t_boot_ms & _MS_32, *q, *rate, 0.0, 0.0, 0.0, 0.0)


def _read_attitude_quaternion(f: Fields) -> AttitudeQuaternion:
    return AttitudeQuaternion(f[0], q_lab_from_flu(*f[1:5]), lab(*f[5:8]))


def _write_inertial(m: InertialSample) -> Written:
    force, rate = ned(m.specific_force_flu_m_s2), ned(m.rate_flu_rad_s)
    updated = _ACCELEROMETER | _GYROSCOPE
    if math.isnan(rate[0] + rate[1] + rate[2]):
        updated, rate = _ACCELEROMETER, (0.0, 0.0, 0.0)
    return HIGHRES_IMU, (m.t_boot_us, *force, *rate, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, updated)


def _read_inertial(f: Fields) -> InertialSample | Unknown:
    """Unknown where the accelerometer has nothing to say."""
    if f[14] & _ACCELEROMETER != _ACCELEROMETER:
        return Unknown(HIGHRES_IMU.id)
    rate = f[4:7] if f[14] & _GYROSCOPE == _GYROSCOPE else (math.nan, math.nan, math.nan)
    return InertialSample(f[0], lab_finite(*f[1:4]), lab(*rate))


def _write_local_position(m: LocalPosition) -> Written:
    return LOCAL_POSITION_NED, (m.t_boot_ms & _MS_32, *ned(m.pos_lab_m), *ned(m.vel_lab_m_s))


def _read_local_position(f: Fields) -> LocalPosition:
    return LocalPosition(f[0], lab_finite(*f[1:4]), lab(*f[4:7]))


def _write_global_position(m: GlobalPosition) -> Written:
    heading = _HEADING_UNKNOWN
    if m.heading_rad is not None:
        heading = round(math.degrees(heading_ned(m.heading_rad)) * 100.0) % 36000
    velocity = _cm_s(m.vel_lab_m_s)
    heights = (_mm(m.alt_m), _mm(m.height_m))
    return GLOBAL_POSITION_INT, (m.t_boot_ms & _MS_32, *_degrees_e7(m), *heights, *velocity, heading)


def _read_global_position(f: Fields) -> GlobalPosition:
    t_boot_ms, lat, lon, alt, height, vn, ve, vd, heading = f
    yaw = None if heading == _HEADING_UNKNOWN else math.remainder(-math.radians(heading * 0.01), 2.0 * math.pi)
    velocity = lab(vn * 0.01, ve * 0.01, vd * 0.01)
    return GlobalPosition(t_boot_ms, lat * 1e-7, lon * 1e-7, alt * 1e-3, height * 1e-3, velocity, yaw)


def _cm_s(vel_lab_m_s: Vec3) -> list[int]:
    """North, east, down in 16 bits: what is faster than 327 m/s reads as 327 m/s, as autopilots send it."""
    return [min(max(round(v * 100.0), -_MOST_16), _MOST_16) for v in ned(vel_lab_m_s)]


def _mm(metres: float) -> int:
    """Millimetres in 32 bits, held at their ends."""
    return min(max(round(metres * 1e3), -_MOST_32), _MOST_32)


def _degrees_e7(m: GlobalPosition | HomePosition | SimTruth) -> tuple[int, int]:
    return round(m.lat_deg * 1e7), round(m.lon_deg * 1e7)


def _write_home(m: HomePosition) -> Written:
    surface = (*_degrees_e7(m), _mm(m.alt_m))
    return HOME_POSITION, (*surface, *ned(m.pos_lab_m), 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0)


def _read_home(f: Fields) -> HomePosition:
    return HomePosition(f[0] * 1e-7, f[1] * 1e-7, f[2] * 1e-3, lab(*f[3:6]))


def _write_truth(m: SimTruth) -> Written:
    velocity = _cm_s(m.vel_lab_m_s)
    surface = (*_degrees_e7(m), _mm(m.alt_m))
    q = q_ned_from_frd(m.q_lab_from_flu)
    return HIL_STATE_QUATERNION, (m.t_us, *q, 0.0, 0.0, 0.0, *surface, *velocity, 0, 0, 0, 0, 0)


def _read_hil_state(f: Fields) -> SimTruth:
    velocity = lab(f[11] * 0.01, f[12] * 0.01, f[13] * 0.01)
    return SimTruth(f[0], q_lab_from_flu(*f[1:5]), velocity, f[8] * 1e-7, f[9] * 1e-7, f[10] * 1e-3)


def _read_sim_state(f: Fields) -> SimTruth:
    """SIM_STATE carries no time; its integer degrees, where filled, are finer than its floats."""
    lat_e7, lon_e7 = f[21:23]
    lat, lon = (lat_e7 * 1e-7, lon_e7 * 1e-7) if lat_e7 or lon_e7 else f[13:15]
    return SimTruth(0, q_lab_from_flu(*f[:4]), lab(*f[18:21]), lat, lon, f[15], 0.0)


WRITERS: Mapping[type, Callable[[Any], Written]] = {
    AttitudeSetpoint: _write_setpoint,
    AttitudeTargetReport: _write_attitude_target,
    VisionPose: _write_vision,
    MocapPose: _write_mocap,
    Odometry: _write_odometry,
    Attitude: _write_attitude,
    AttitudeQuaternion: _write_attitude_quaternion,
    InertialSample: _write_inertial,
    LocalPosition: _write_local_position,
    GlobalPosition: _write_global_position,
    HomePosition: _write_home,
    SimTruth: _write_truth,
}

READERS: Mapping[Layout, Callable[[Fields], Any]] = {
    SET_ATTITUDE_TARGET: _read_setpoint,
    ATTITUDE_TARGET: _read_attitude_target,
    VISION_POSITION_ESTIMATE: _read_vision,
    ATT_POS_MOCAP: _read_mocap,
    ODOMETRY: _read_odometry,
    ATTITUDE: _read_attitude,
    ATTITUDE_QUATERNION: _read_attitude_quaternion,
    HIGHRES_IMU: _read_inertial,
    LOCAL_POSITION_NED: _read_local_position,
    GLOBAL_POSITION_INT: _read_global_position,
    HOME_POSITION: _read_home,
    HIL_STATE_QUATERNION: _read_hil_state,
    SIM_STATE: _read_sim_state,
}

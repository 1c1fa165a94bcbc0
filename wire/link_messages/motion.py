"""Poses and motions of a body: sent to the autopilot, estimated by it, or true in a simulator."""

from enum import IntEnum
from typing import NamedTuple

from formation.maths.arrays import Quat, Vec3


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


FORCE_MOST_M_S2 = 157.0
"""16 g along an axis: no accelerometer of an autopilot shows more."""


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
    """HIL_STATE_QUATERNION (115) or SIM_STATE (108): a simulated autopilot's true state.

    vel_step_m_s: resolution of the velocity: 0.01 in HIL_STATE_QUATERNION, 0 (floats) in SIM_STATE.
    """

    t_us: int
    q_lab_from_flu: Quat
    vel_lab_m_s: Vec3
    lat_deg: float
    lon_deg: float
    alt_m: float
    vel_step_m_s: float = 0.01

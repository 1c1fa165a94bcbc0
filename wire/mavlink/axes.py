"""Between `lab`, `flu` and MAVLink's axes: the only place that knows north, east, down and forward, right, down.

Lab x is north and lab y is west: both turns are diag(1, -1, -1), their own inverse. Quaternions are `w, x, y, z`.
Scalars in, scalars out: these run for every packet. Positions and attitudes must be finite; velocities and rates may be
NaN, MAVLink's "unknown".
"""

import math

import numpy as np

from formation.maths.arrays import Float, Quat, Vec3
from wire.mavlink.framing import MavlinkError

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


def lab_of(vectors: Float) -> Float:
    """v_lab of v_ned, v_flu of v_frd, (..., 3); and q_lab_from_flu of q_ned_from_frd, (..., 4), w first."""
    turned: Float = vectors * np.array([1.0] * (np.shape(vectors)[-1] - 2) + [-1.0, -1.0])
    return turned


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


def euler_ned_from_frd(q_lab_from_flu: Quat) -> Triple:
    """Roll, pitch, yaw (intrinsic z-y-x, rad) of the body FRD in NED, from q_lab_from_flu."""
    return euler(*q_ned_from_frd(q_lab_from_flu))


def euler(w: float, x: float, y: float, z: float) -> Triple:
    """Roll, pitch, yaw (intrinsic z-y-x, rad) of a quaternion; plain, and part of a compiled loop."""
    sin_pitch = 2.0 * (w * y - z * x)
    if abs(sin_pitch) > POLE:
        side = math.copysign(1.0, sin_pitch)
        return 0.0, side * 0.5 * math.pi, exact(-2.0 * side * math.atan2(x, w))
    roll = math.atan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))
    yaw = math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
    return exact(roll), exact(math.asin(sin_pitch)), exact(yaw)


def exact(angle: float) -> float:
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

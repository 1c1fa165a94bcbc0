"""From demanded acceleration to attitude, body rates and thrust, within tilt and thrust (Eq. 1 inverted)."""

from dataclasses import dataclass
from math import cos, sin, sqrt, tan

import numpy as np
from numpy.typing import NDArray

from formation.control.composite_law import Demand
from formation.control.limits import keep_apart, keep_inside
from formation.estimation.state import EstimatorState
from formation.estimation.update import doubt
from formation.guidance.reference_generator import Course
from formation.maths.arrays import Flags, Float, Quats, Scalars, Vec3s
from formation.maths.kernel import kernel
from formation.vehicle.body import GRAVITY_M_S2
from formation.vehicle.profile import VehicleProfile
from formation.vehicle.response import SECONDS
from formation.vehicle.rigid_body import thrust_norm

TILT, THRUST_LOW, THRUST_HIGH = 1.0, 2.0, 4.0  # bits of formation.messages.Saturation
LIFT_LEAST = 0.45  # of gravity: below it the attitude says nothing and the autopilot has no authority
LIFT_MOST = 0.92  # of full thrust: what is left turns the vehicle
UPWARD_MOST = 0.88  # of that: climbing must leave something to steer with
LEAD_TILT_RAD = 1.1  # how far the lag's inversion may point where body rates carry it
AUTHORITY_LEAST = 0.55  # of a vehicle that does not answer as its profile says
RAMP_START, RAMP_1_S, RAMP_MOST = 0.2, 0.9, 1.9  # thrust over weight while waiting for lift-off


@dataclass(frozen=True, slots=True, eq=False)
class AttitudeSettings:
    """Per commanded vehicle m: vehicle (m) index among the n; body (m, 6): `body_row`; fence corners (3)."""

    vehicle: NDArray[np.int64]
    body: Float
    tilt_max_rad: float
    separation_m: float
    fence_low_m: Float
    fence_high_m: Float
    fence_margin_m: float


@dataclass(frozen=True, slots=True, eq=False)
class Attitude:
    """Attitude, body rates, thrust_norm and saturation bits (m); force (m, 4): what the history must remember."""

    q_lab_from_flu: Quats
    rate_flu_rad_s: Vec3s
    thrust_norm: Scalars
    saturation: Scalars
    force: Float


CURVE, ATTITUDE_P, YAW_P, FEED_FORWARD, RATE_MAX, AUTHORITY = range(6)


def body_row(profile: VehicleProfile) -> Float:
    """What the inversion needs of one vehicle, in the order of the names above."""
    return np.array(
        [profile.thrust_curve, profile.attitude_p_1_s, profile.yaw_p_1_s,
         float(profile.rate_feed_forward), profile.rate_max_rad_s, turn_authority(profile)]
    )  # fmt: skip


def turn_authority(profile: VehicleProfile) -> float:
    """Attitude error, rad per m/s^2 of thrust, whose correction asks the motors for all the torque they have.

    The attitude and rate loops turn an error into an angular acceleration; a motor can only stop or double.
    """
    return profile.turn_1_m / (profile.attitude_p_1_s * profile.rate_p_1_s)


def attitude(
    settings: AttitudeSettings, wanted: Demand, state: EstimatorState, course: Course, idle: Flags,
    hover_thrust_norm: Scalars, now_ns: int,
) -> Attitude:  # fmt: skip
    """The attitude targets that realise the demand; idle vehicles get zero thrust, waiting ones a rising, level one.

    hover_thrust_norm (m): what hovers each vehicle as its profile describes it; fixes the scale of thrust_norm.
    """
    m = len(settings.vehicle)
    out = Attitude(np.zeros((m, 4)), np.zeros((m, 3)), np.zeros(m), np.zeros(m), np.zeros((m, 4)))
    _attitude(
        settings.vehicle, settings.body, settings.tilt_max_rad, settings.separation_m, settings.fence_low_m,
        settings.fence_high_m, settings.fence_margin_m, wanted.acc, wanted.lead_acc, wanted.motion, wanted.force,
        wanted.lift_cos, wanted.yaw, state.pos_lab_m, state.strength, state.misfit, course.airborne,
        course.release_ns, idle, hover_thrust_norm, now_ns,
        out.q_lab_from_flu, out.rate_flu_rad_s, out.thrust_norm, out.saturation, out.force,
    )  # fmt: skip
    return out


@kernel
def attitude_of(x: float, y: float, z: float, yaw: float, q: Float) -> None:
    """q_lab_from_flu with body z along the force (x, y, z) and the heading's axis in the body's x-z plane, into q (4).

    y_b = z_b x x_yaw, normalised; x_b = y_b x z_b (Eq. 1's angles, without their singular arithmetic).
    """
    size = sqrt(x * x + y * y + z * z)
    zx, zy, zz = x / size, y / size, z / size
    cx, cy = cos(yaw), sin(yaw)
    yx, yy, yz = -zz * cy, zz * cx, zx * cy - zy * cx
    length = sqrt(yx * yx + yy * yy + yz * yz)
    yx, yy, yz = yx / length, yy / length, yz / length
    xx, xy, xz = yy * zz - yz * zy, yz * zx - yx * zz, yx * zy - yy * zx
    # Shepperd's formula; tilt stays under pi/2, so the trace and m22 = zz share the safe branches.
    trace = xx + yy + zz
    if trace > zz:
        w = sqrt(1.0 + trace)
        q[0], q[1], q[2], q[3] = 0.5 * w, 0.5 * (yz - zy) / w, 0.5 * (zx - xz) / w, 0.5 * (xy - yx) / w
    else:
        w = sqrt(1.0 + zz - xx - yy)
        q[0], q[1], q[2], q[3] = 0.5 * (xy - yx) / w, 0.5 * (zx + xz) / w, 0.5 * (yz + zy) / w, 0.5 * w
    if q[0] < 0.0:
        for k in range(4):
            q[k] = -q[k]


@kernel
def body_rates(force: Float, force_rate: Float, yaw: float, yaw_rate: float, rate: Float) -> None:
    """Body rates (flu) of the attitude that follows a force (3) changing at force_rate (3), into rate (3).

    Differential flatness, after Mellinger and Kumar (2011): the turn of z_b is what the force's direction does.
    """
    size = sqrt(force[0] * force[0] + force[1] * force[1] + force[2] * force[2])
    zx, zy, zz = force[0] / size, force[1] / size, force[2] / size
    along = force_rate[0] * zx + force_rate[1] * zy + force_rate[2] * zz
    hx = (force_rate[0] - along * zx) / size
    hy = (force_rate[1] - along * zy) / size
    hz = (force_rate[2] - along * zz) / size
    cx, cy = cos(yaw), sin(yaw)
    yx, yy, yz = -zz * cy, zz * cx, zx * cy - zy * cx
    length = sqrt(yx * yx + yy * yy + yz * yz)
    yx, yy, yz = yx / length, yy / length, yz / length
    xx, xy, xz = yy * zz - yz * zy, yz * zx - yx * zz, yx * zy - yy * zx
    rate[0] = -(hx * yx + hy * yy + hz * yz)
    rate[1] = hx * xx + hy * xy + hz * xz
    rate[2] = yaw_rate * zz


@kernel
def bound_force(force: Float, lift_most: float, tilt_max_rad: float) -> float:
    """Bounds a specific force (3) in place, height before sideways; returns the bits of the limits it met."""
    bits = 0.0
    least, most = LIFT_LEAST * GRAVITY_M_S2, UPWARD_MOST * lift_most
    if force[2] < least:
        force[2] = least
        bits += THRUST_LOW
    elif force[2] > most:
        force[2] = most
        bits += THRUST_HIGH
    flat = sqrt(force[0] * force[0] + force[1] * force[1])
    by_tilt = force[2] * tan(tilt_max_rad)
    by_thrust = sqrt(lift_most * lift_most - force[2] * force[2])
    most = min(by_tilt, by_thrust)
    if flat > most:
        force[0] *= most / flat
        force[1] *= most / flat
        bits += TILT
    return bits


@kernel
def bound_turn(force: Float, now: Float, authority: float, full: float) -> None:
    """Keeps the horizontal force asked for within what the motors can turn to from the one expected `now` (3).

    Beyond it the attitude loop saturates, cannot brake in time and overshoots, and a mixer that puts attitude first
    takes the torque out of the lift. authority: see `turn_authority`; full: specific force of full thrust.
    """
    dx, dy = force[0] - now[0], force[1] - now[1]
    size = sqrt(dx * dx + dy * dy)
    most = authority * force[2] * max(min(force[2], full - force[2]), 0.0)
    if size > most:
        force[0] = now[0] + dx * most / size
        force[1] = now[1] + dy * most / size


@kernel
def authority_kept(misfit: float) -> float:
    """Share of its turn authority that a vehicle is trusted with: less where it answers otherwise than believed.

    One that asks its motors for several times the torque the profile expects would swing from stop to stop.
    """
    return 1.0 - (1.0 - AUTHORITY_LEAST) * doubt(misfit)


@kernel
def _attitude(
    vehicle: NDArray[np.int64], body: Float, tilt_max: float, separation: float, low: Float, high: Float, margin: float,
    acc: Float, lead_acc: Float, motion: Float, force: Float, lift_cos: Float, yaw: Float, pos: Float, strength: Float,
    misfit: Float, airborne: NDArray[np.bool_], release_ns: NDArray[np.int64], idle: NDArray[np.bool_],
    hover_norm: Float, now_ns: int, q: Float, rate: Float, norm: Float, saturation: Float, sent: Float,
) -> None:  # fmt: skip
    """See `attitude`."""
    aim, felt, turn = np.empty(3), np.empty(3), np.empty(3)
    for i in range(len(vehicle)):
        curve = body[i, CURVE]
        # The thrust scale at which the profile's weight hovers at hover_norm.
        u = min(max(hover_norm[i], 0.05), 0.95)
        full = GRAVITY_M_S2 / ((1.0 - curve) * u + curve * u * u)
        heading = yaw[i, 0]
        if idle[i]:
            attitude_of(0.0, 0.0, 1.0, heading, q[i])
            continue
        if not airborne[i]:
            waited = (now_ns - release_ns[i]) * SECONDS
            lift = GRAVITY_M_S2 * min(RAMP_START + RAMP_1_S * waited, RAMP_MOST)
            attitude_of(0.0, 0.0, 1.0, heading, q[i])
            norm[i] = thrust_norm(min(lift / full, 1.0), curve)
            sent[i, 2] = sent[i, 3] = min(lift, full)
            continue
        k = strength[vehicle[i]]
        for axis in range(3):
            aim[axis] = acc[i, axis]
        bits = keep_apart(i, vehicle, pos, motion[i, 0], separation, aim)
        bits += keep_inside(motion[i], low, high, margin, aim)
        aim[2] += GRAVITY_M_S2
        for axis in range(3):
            aim[axis] /= k
            felt[axis] = aim[axis] + lead_acc[i, axis] / k
        by_rate = body[i, FEED_FORWARD] > 0.0
        met = bound_force(aim, LIFT_MOST * full, tilt_max)
        met_later = bound_force(felt, LIFT_MOST * full, LEAD_TILT_RAD if by_rate else tilt_max)
        saturation[i] = bits + (met if by_rate else max(met, met_later))
        trusted = body[i, AUTHORITY] * authority_kept(misfit[vehicle[i]])
        for vector in (aim, felt):
            bound_turn(vector, force[i], trusted, full)
        for axis in range(3):
            turn[axis] = felt[axis] - aim[axis]
        if by_rate:
            # The autopilot adds body rates: what inverts its lag goes there, and the attitude stays the one wanted.
            attitude_of(aim[0], aim[1], felt[2], heading, q[i])
            body_rates(aim, turn, heading, yaw[i, 1], rate[i])
            for axis in range(2):
                rate[i, axis] = min(max(body[i, ATTITUDE_P] * rate[i, axis], -body[i, RATE_MAX]), body[i, RATE_MAX])
        else:
            attitude_of(felt[0], felt[1], felt[2], heading + yaw[i, 1] / body[i, YAW_P], q[i])
        lift = min(felt[2] / max(lift_cos[i], cos(tilt_max)), full)
        norm[i] = thrust_norm(lift / full, curve)
        flat = lift / sqrt(felt[0] * felt[0] + felt[1] * felt[1] + felt[2] * felt[2])
        sent[i, 0], sent[i, 1], sent[i, 2], sent[i, 3] = flat * felt[0], flat * felt[1], felt[2], lift

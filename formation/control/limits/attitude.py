"""From demanded acceleration to attitude, body rates and thrust (Eq. 1 inverted), within every limit on the force.

The limits act in this order: the fence, on the demanded acceleration; lift, tilt, thrust and turn, on the specific
force that it asks for. The attitude, the body rates and the thrust are those of the bounded force. What keeps commanded
vehicles inside the fence bounds them gently and early.
"""

from dataclasses import dataclass
from math import cos, sin, sqrt, tan

import numpy as np

from formation.control.law import Demand
from formation.estimation.response import SECONDS, doubt
from formation.estimation.state import VehicleEstimate
from formation.guidance.reference_generator import POINT, VehicleReference
from formation.maths.arrays import Float, Quat, Scalars, Vec3, Vec4
from formation.maths.kernel import kernel
from formation.maths.quaternion import attitude_of, heading_axes
from formation.maths.records import Rows, blank
from formation.messages import Saturation as Met
from formation.vehicle.body import GRAVITY_M_S2
from formation.vehicle.profile import VehicleProfile
from formation.vehicle.rigid_body import thrust_norm

TILT, THRUST_LOW, THRUST_HIGH, FENCE = map(float, (Met.TILT, Met.THRUST_LOW, Met.THRUST_HIGH, Met.FENCE))
FENCE_BRAKE_M_S2, FENCE_RATE_1_S = 4.0, 4.0
LIFT_LEAST = 0.45  # of gravity: below it the attitude says nothing and the autopilot has no authority
SINK_MOST_M_S2, SINKING_FROM_M_S = 1.0, 0.5  # what lands is not pushed down harder while it sinks
SCALE_KNOWN_S = 6.0  # since its release: three times the thrust scale's own lag
LIFT_MOST = 0.92  # of full thrust: what is left turns the vehicle
UPWARD_MOST = 0.88  # of that: climbing must leave something to steer with
LEAD_TILT_RAD = 1.1  # how far the lag's inversion may point where body rates carry it
AUTHORITY_LEAST = 0.55  # of a vehicle that does not answer as its profile says
TURN_STEP_S = 0.01  # over which the heading's turn is differentiated
RAMP_START, RAMP_1_S, RAMP_MOST = 0.2, 0.9, 1.9  # thrust over weight while waiting for lift-off


@dataclass(frozen=True, slots=True)
class ForceLimits:
    """What bounds the force of one commanded vehicle; a record.

    vehicle: its index among the n; drag_1_s: see ObserverSettings; turn_authority_rad_s2_m: `turn_authority`;
    response_s: dead time and lag of its attitude; rate_feed_forward: whether its autopilot adds the body rates of a
    target; sink_most_m_s: the sink rate of a landing at which it is no longer pushed down.
    """

    vehicle: int
    drag_1_s: Vec3
    rate_feed_forward: bool
    turn_authority_rad_s2_m: float
    response_s: float
    tilt_max_rad: float
    fence_low_m: Vec3
    fence_high_m: Vec3
    fence_margin_m: float
    sink_most_m_s: float


def turn_authority(profile: VehicleProfile) -> float:
    """Attitude error, rad per m/s^2 of thrust, whose correction asks the motors for all the torque they have.

    The attitude and rate loops turn an error into an angular acceleration; a motor can only stop or double.
    """
    return profile.turn_1_m / (profile.attitude_p_1_s * profile.rate_p_1_s)


@dataclass(frozen=True, slots=True)
class AttitudeSettings:
    """What turns one commanded vehicle's demand into a target; a record.

    attitude_lag_s: what the demand's lead inverts; yaw_lag_s, heading_lag_s: by how much its yaw rate is later than the
    attitude's dead time and than the thrust's, when tilts and headings are asked for; rate_feed_forward: whether its
    autopilot adds the body rates of a target.
    """

    thrust_curve: float
    attitude_lag_s: float
    attitude_p_1_s: float
    yaw_p_1_s: float
    yaw_lag_s: float
    heading_lag_s: float
    rate_feed_forward: bool
    rate_max_rad_s: float
    tilt_max_rad: float


@dataclass(slots=True)
class Target:
    """One vehicle's attitude, body rates, thrust and saturation bits; a record.

    force: specific force that this asks for, and its length, as formation.estimation.response remembers it.
    """

    q_lab_from_flu: Quat
    rate_flu_rad_s: Vec3
    thrust_norm: float
    saturation: float
    force: Vec4


def attitude(
    settings: Rows[AttitudeSettings], limits: Rows[ForceLimits], wanted: Rows[Demand],
    estimates: Rows[VehicleEstimate], references: Rows[VehicleReference], hover_thrust_norm: Scalars, now_ns: int,
) -> Rows[Target]:  # fmt: skip
    """The targets (m) that realise the demand; idle vehicles get zero thrust, waiting ones a rising, level one.

    hover_thrust_norm (m): what hovers each vehicle as its profile describes it; fixes the scale of thrust_norm.
    """
    out = blank(Target, len(settings))
    _targets(settings, limits, wanted, estimates, references, hover_thrust_norm, now_ns, out)
    return out


@kernel
def _targets(
    settings: Rows[AttitudeSettings], limits: Rows[ForceLimits], wanted: Rows[Demand],
    estimates: Rows[VehicleEstimate], references: Rows[VehicleReference], hover_thrust_norm: Float, now_ns: int,
    out: Rows[Target],
) -> None:  # fmt: skip
    """See `attitude`."""
    aim, lead = np.empty(3), np.empty(3)
    for i in range(len(settings)):
        # The thrust scale at which the profile's weight hovers at hover_thrust_norm.
        u = min(max(hover_thrust_norm[i], 0.05), 0.95)
        curve = settings[i].thrust_curve
        full = GRAVITY_M_S2 / ((1.0 - curve) * u + curve * u * u)
        if references[i].idle:
            attitude_of(0.0, 0.0, 1.0, wanted[i].yaw_rad, out[i].q_lab_from_flu)
        elif not references[i].airborne:
            _wait(settings[i], wanted[i].yaw_rad, (now_ns - references[i].release_ns) * SECONDS, full, out[i])
        else:
            met = limit_force(limits[i], wanted[i], estimates, references[i], now_ns, full, aim, lead)
            out[i].saturation = met
            _target(settings[i], wanted[i], estimates[limits[i].vehicle].thrust_scale, aim, lead, full, out[i])


@kernel
def limit_force(
    s: ForceLimits, wanted: Demand, estimates: Rows[VehicleEstimate], reference: VehicleReference, now_ns: int,
    full: float, aim: Float, lead: Float,
) -> float:  # fmt: skip
    """Write a demand's specific force into aim (3), with the lag's inversion into lead (3); the bits of the limits met.

    aim before the limits is u of Eq. (7): the demanded acceleration less f(x), gravity and drag, over the thrust scale.
    full: specific force of full thrust, m/s^2.
    """
    z = estimates[s.vehicle]
    for axis in range(3):
        aim[axis] = wanted.acc_lab_m_s2[axis]
    down = lands(reference)
    low, high, margin_m = s.fence_low_m, s.fence_high_m, s.fence_margin_m
    bits = wanted.limits_met + limit_to_fence(wanted.motion, low, high, margin_m, down, aim)
    aim[2] += GRAVITY_M_S2
    for axis in range(3):
        aim[axis] = (aim[axis] + s.drag_1_s[axis] * wanted.motion[1, axis]) / z.thrust_scale
        lead[axis] = aim[axis] + wanted.lead_acc_lab_m_s2[axis] / z.thrust_scale
    least = LIFT_LEAST * GRAVITY_M_S2
    if down:
        least = minimum_lift(
            (now_ns - reference.release_ns) * SECONDS, wanted.motion[1, 2], z.thrust_scale, s.sink_most_m_s
        )
    met = clamp_force(aim, least, LIFT_MOST * full, s.tilt_max_rad)
    met_later = clamp_force(lead, least, LIFT_MOST * full, LEAD_TILT_RAD if s.rate_feed_forward else s.tilt_max_rad)
    trusted = s.turn_authority_rad_s2_m * trusted_authority(z.model_error.mismatch)
    length = 1.0 - max(z.model_error.delay_shift_s, 0.0) / s.response_s
    clamp_turn(aim, wanted.specific_force_lab_m_s2, trusted, length, full)
    clamp_turn(lead, wanted.specific_force_lab_m_s2, trusted, length, full)
    return bits + (met if s.rate_feed_forward else max(met, met_later))


@kernel
def lands(reference: VehicleReference) -> bool:
    """Whether a vehicle is led down to the floor, to a point of the lab beneath where it stood."""
    return reference.kind == POINT and reference.target[2] < reference.floor_m


@kernel
def minimum_lift(airborne_s: float, climb_m_s: float, thrust_scale: float, sink_most_m_s: float) -> float:
    """The least specific force upwards, m/s^2, of a vehicle that lands, so long in the air and climbing so fast.

    None has to be pushed down to land: one whose height is older than its stamp says must not be thrown at the floor
    by a loop that swings, nor one that its commands reach again plunge after its reference; at sink_most_m_s it is not
    pushed at all. It counts from when the thrust scale is known; what climbs is stopped as any other.
    """
    least = LIFT_LEAST * GRAVITY_M_S2
    if airborne_s < SCALE_KNOWN_S:
        return least
    sinks = 1.0 - min(max(climb_m_s / SINKING_FROM_M_S, 0.0), 1.0)
    push_m_s2 = SINK_MOST_M_S2 * min(max((sink_most_m_s + climb_m_s) / SINKING_FROM_M_S, 0.0), 1.0)
    return max(least, least + sinks * ((GRAVITY_M_S2 - push_m_s2) / thrust_scale - least))


@kernel
def limit_to_fence(motion: Float, low: Float, high: Float, margin_m: float, lands: bool, acc: Float) -> float:
    """Bounds acc (3) so that the vehicle can always stop margin_m before the fence; returns the bit if it had to.

    motion (3, 4): predicted. The speed towards a wall d metres off is held under sqrt(2 a d); past it, inwards.
    lands: the fence's floor does not bound it, for where that lies against the room's floor nobody measures.
    """
    bit = 0.0
    for axis in range(3):
        for side in range(1 if lands and axis == 2 else 0, 2):
            sign = 1.0 if side == 1 else -1.0
            wall = high[axis] if side == 1 else -low[axis]
            distance_m = wall - margin_m - sign * motion[0, axis]
            speed = sign * motion[1, axis]
            if distance_m > 0.0:
                allowed = sqrt(2.0 * FENCE_BRAKE_M_S2 * distance_m)
                most = FENCE_RATE_1_S * (allowed - speed) - FENCE_BRAKE_M_S2 * max(speed, 0.0) / allowed
            else:
                most = FENCE_RATE_1_S * (FENCE_RATE_1_S * distance_m - speed)
            if sign * acc[axis] > most:
                acc[axis] = sign * most
                bit = FENCE
    return bit


@kernel
def clamp_force(force: Float, least: float, lift_most: float, tilt_max_rad: float) -> float:
    """Bounds a specific force (3) in place, height before sideways; returns the bits of the limits it met.

    least, lift_most: specific forces, upwards and of all the thrust that may be asked for.
    """
    bits = 0.0
    most = UPWARD_MOST * lift_most
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
def clamp_turn(force: Float, now: Float, authority: float, length: float, full: float) -> None:
    """Keeps the horizontal force asked for within what the motors can turn to from the one expected `now` (3).

    Beyond it the attitude loop saturates, cannot brake in time and overshoots, and a mixer that puts attitude first
    takes the torque out of the lift. authority: see `turn_authority`; full: specific force of full thrust. length: of
    the vehicle's answer as it is seen, over the profile's, at most 1. Loops so much faster meet an error with the
    inverse square of it in torque. Below half of full thrust that saturates, and costs no lift; at full thrust, all.
    """
    dx, dy = force[0] - now[0], force[1] - now[1]
    size = sqrt(dx * dx + dy * dy)
    costly = max(2.0 * force[2] / full - 1.0, 0.0)
    left = (1.0 - costly * (1.0 - length * length)) * (full - force[2])
    most = authority * force[2] * max(min(force[2], left), 0.0)
    if size > most:
        force[0] = now[0] + dx * most / size
        force[1] = now[1] + dy * most / size


@kernel
def trusted_authority(mismatch: float) -> float:
    """Share of its turn authority that a vehicle is trusted with: less where it answers otherwise than believed.

    One that asks its motors for several times the torque the profile expects would swing from stop to stop.
    """
    return 1.0 - (1.0 - AUTHORITY_LEAST) * doubt(mismatch)


@kernel
def _wait(s: AttitudeSettings, yaw_rad: float, waited_s: float, full: float, out: Target) -> None:
    """Level, thrust rising until it lifts off."""
    thrust = GRAVITY_M_S2 * min(RAMP_START + RAMP_1_S * waited_s, RAMP_MOST)
    attitude_of(0.0, 0.0, 1.0, yaw_rad, out.q_lab_from_flu)
    out.thrust_norm = thrust_norm(min(thrust / full, 1.0), s.thrust_curve)
    out.force[2] = out.force[3] = min(thrust, full)


@kernel
def _target(
    s: AttitudeSettings, wanted: Demand, thrust_scale: float, aim: Float, lead: Float, full: float, out: Target
) -> None:
    """Attitude, body rates and thrust of bounded forces aim and lead (3)."""
    heading = wanted.yaw_rad
    turn = _heading_turn(s, wanted, thrust_scale, aim)
    if s.rate_feed_forward:
        # The autopilot adds body rates: what inverts its lag goes there, and the attitude stays the one wanted.
        attitude_of(aim[0], aim[1], lead[2], heading, out.q_lab_from_flu)
        rate, most = out.rate_flu_rad_s, s.rate_max_rad_s
        body_rates(aim, s.attitude_p_1_s * (lead - aim), heading, wanted.yaw_rate_rad_s, rate)
        rate[2] = turn * upright(aim)
        for axis in range(3):
            rate[axis] = min(max(rate[axis], -most), most)
    else:
        attitude_of(lead[0], lead[1], lead[2], heading + turn / s.yaw_p_1_s, out.q_lab_from_flu)
    thrust = min(lead[2] / max(wanted.tilt_cos, cos(s.tilt_max_rad)), full)
    out.thrust_norm = thrust_norm(thrust / full, s.thrust_curve)
    flat = thrust / sqrt(lead[0] * lead[0] + lead[1] * lead[1] + lead[2] * lead[2])
    out.force[0], out.force[1], out.force[2], out.force[3] = flat * lead[0], flat * lead[1], lead[2], thrust


@kernel
def upright(force: Float) -> float:
    """Cosine of the tilt of a force (3)."""
    cosine: float = force[2] / sqrt(force[0] * force[0] + force[1] * force[1] + force[2] * force[2])
    return cosine


@kernel
def _heading_turn(s: AttitudeSettings, wanted: Demand, thrust_scale: float, aim: Float) -> float:
    """At which rate the heading has to be led, rad/s, for it to turn as wanted while the tilt changes as planned.

    A tilt that changes takes a turn about z_b too, or the heading wanders. Of that turn the autopilot's heading loop
    asks for a part by itself: its tilt is behind the target's by the turn over attitude_p_1_s, less what the body rates
    carry, and from one tilt to the next at the same heading the error has a twist (Brescianini et al. 2013). The yaw
    rate comes late, that of the heading's own turn, too: about z_b a vehicle is turned by its rotors' drag alone.
    """
    behind_s = 1.0 / s.attitude_p_1_s - (s.attitude_lag_s if s.rate_feed_forward else 0.0)
    later, rate = np.empty(3), np.empty(3)
    for axis in range(3):
        later[axis] = aim[axis] + TURN_STEP_S * wanted.acc_rate_lab_m_s3[axis] / thrust_scale
        rate[axis] = wanted.acc_rate_lab_m_s3[axis] + TURN_STEP_S * wanted.snap_lab_m_s4[axis]
    now = _turn_of_tilt(aim, wanted.acc_rate_lab_m_s3, wanted, thrust_scale)
    growing = (_turn_of_tilt(later, rate, wanted, thrust_scale) - now) / TURN_STEP_S
    heading = wanted.yaw_rate_rad_s + s.heading_lag_s * wanted.yaw_acc_rad_s2
    turn: float = heading + now + s.yaw_lag_s * growing - s.yaw_p_1_s * behind_s * now
    return turn


@kernel
def _turn_of_tilt(force: Float, acc_rate_lab_m_s3: Float, wanted: Demand, thrust_scale: float) -> float:
    """What the turn of a force (3) alone asks of the rate of the heading, rad/s."""
    rate = np.empty(3)
    body_rates(force, acc_rate_lab_m_s3 / thrust_scale, wanted.yaw_rad, wanted.yaw_rate_rad_s, rate)
    turn: float = rate[2] / upright(force) - wanted.yaw_rate_rad_s
    return turn


@kernel
def body_rates(force: Float, force_rate: Float, yaw: float, yaw_rate: float, rate: Float) -> None:
    """Body rates (flu) of the attitude that follows a force (3) changing at force_rate (3), into rate (3).

    Differential flatness, after Mellinger and Kumar (2011): the turn of z_b is what the force's direction does, and
    that about z_b keeps x_b normal to y_C = (-sin yaw, cos yaw, 0), whose turn is yaw_rate.
    """
    size = sqrt(force[0] * force[0] + force[1] * force[1] + force[2] * force[2])
    zx, zy, zz = force[0] / size, force[1] / size, force[2] / size
    (xx, xy, xz), (yx, yy, yz) = heading_axes(zx, zy, zz, yaw)
    cy, sy = cos(yaw), sin(yaw)
    rate[0] = -(force_rate[0] * yx + force_rate[1] * yy + force_rate[2] * yz) / size
    rate[1] = (force_rate[0] * xx + force_rate[1] * xy + force_rate[2] * xz) / size
    rate[2] = (yaw_rate * (xx * cy + xy * sy) + rate[1] * (zy * cy - zx * sy)) / (yy * cy - yx * sy)

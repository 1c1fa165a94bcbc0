"""The inertial samples and thrusts of one body, and what they alone say of its motion until now."""

from math import exp, isfinite

import numpy as np

from formation.maths.arrays import Float
from formation.maths.copying import copy_into
from formation.maths.kernel import kernel
from formation.maths.quaternion import matrix_into, turn_into
from formation.maths.records import Rows
from formation.navigation.error_state import move
from formation.navigation.evidence import copy_estimate
from formation.navigation.state import SAMPLES, THRUSTS, Body, Estimate, Inertial
from formation.vehicle.body import GRAVITY_M_S2

FORCE_LEARN_S = 0.25
"""Time constant of the sensors' learned noise: vibration comes with the motors."""


@kernel
def add_sample(body: Body, t_ns: int, force_flu_m_s2: Float, rate_flu_rad_s: Float, rate_var: float) -> None:
    """Keeps one inertial sample, later than the last, and learns the sensors' noise from what differs between two.

    rate_var: of this body rate, where that is known otherwise; NaN.
    """
    ring, noise = body.inertial, body.noise
    at = ring.count % SAMPLES
    ring.t_ns[at] = t_ns
    copy_into(force_flu_m_s2, ring.force_flu_m_s2[at])
    copy_into(rate_flu_rad_s, ring.rate_flu_rad_s[at])
    ring.count += 1
    share = 1.0 - exp(-(t_ns - noise.last_ns) * 1e-9 / FORCE_LEARN_S)
    for axis in range(3):
        force = force_flu_m_s2[axis] - noise.last_force_flu_m_s2[axis]
        rate = rate_flu_rad_s[axis] - noise.last_rate_flu_rad_s[axis]
        if isfinite(force):  # of a modelled sample nothing is learned
            noise.force_m2_s4[axis] += share * (0.5 * force * force - noise.force_m2_s4[axis])
        if noise.last_ns:
            square = rate_var if isfinite(rate_var) else 0.5 * rate * rate
            noise.rate_rad2_s2[axis] += share * (square - noise.rate_rad2_s2[axis])
        noise.last_force_flu_m_s2[axis] = force_flu_m_s2[axis]
        noise.last_rate_flu_rad_s[axis] = rate_flu_rad_s[axis]
    noise.last_ns = t_ns


@kernel
def next_sample(ring: Inertial, t_ns: int) -> int:
    """The number of the first kept sample that ends after t_ns; `count` where there is none."""
    first = ring.count
    oldest = max(ring.count - SAMPLES, 0)
    while first > oldest and ring.t_ns[(first - 1) % SAMPLES] > t_ns:
        first -= 1
    return first


@kernel
def measures_force(ring: Inertial) -> bool:
    """Whether an accelerometer shows the motion; else it is modelled by thrust and attitude."""
    return ring.count > 0 and isfinite(ring.force_flu_m_s2[(ring.count - 1) % SAMPLES, 0])


@kernel
def thrust_at(body: Body, t_ns: int) -> float:
    """The thrust commanded at a time, as specific force; NaN where nobody knows."""
    ring = body.commanded
    for back in range(1, min(ring.count, THRUSTS) + 1):
        at = (ring.count - back) % THRUSTS
        if ring.t_ns[at] <= t_ns:
            return float(ring.thrust_m_s2[at])
    return np.nan


@kernel
def follow_thrust(body: Body, dt_s: float) -> float:
    """The modelled thrust, m/s^2, after dt_s: a lag behind what was commanded a dead time ago."""
    x, frame = body.estimate, body.airframe
    wanted = thrust_at(body, x.t_ns - frame.thrust_dead_time_ns)
    if isfinite(wanted) and isfinite(x.thrust_m_s2) and frame.thrust_lag_s > 0.0:
        x.thrust_m_s2 += (1.0 - exp(-dt_s / frame.thrust_lag_s)) * (wanted - x.thrust_m_s2)
    else:
        x.thrust_m_s2 = wanted
    return float(x.thrust_m_s2)


@kernel
def model_force(body: Body, thrust_m_s2: float, force: Float) -> None:
    """The specific force by thrust and drag, and the bias in it, into force (3)."""
    x = body.estimate
    r = np.empty((3, 3))
    matrix_into(x.q_lab_from_flu, r)
    for axis in range(3):
        vel = 0.0
        for k in range(3):
            vel += r[k, axis] * x.vel_lab_m_s[k]
        force[axis] = x.accel_bias_flu_m_s2[axis] - body.airframe.drag_flu_1_s[axis] * vel
    force[2] += x.thrust_scale * thrust_m_s2 if isfinite(thrust_m_s2) else GRAVITY_M_S2


@kernel
def attitude_at(x: Estimate, ring: Inertial, t_ns: int, q: Float) -> None:
    """The attitude predicted for a time from the horizon on by the body rates, into q (4)."""
    rate, turned, at_ns = np.empty(3), np.empty(4), x.t_ns
    copy_into(x.q_lab_from_flu, q)
    number = next_sample(ring, at_ns)
    while at_ns != t_ns:
        end_ns = t_ns
        copy_into(x.rate_flu_rad_s, rate)
        if t_ns > at_ns and ring.count > 0:
            at = min(number, ring.count - 1) % SAMPLES
            copy_into(ring.rate_flu_rad_s[at], rate)
            if number < ring.count:
                end_ns = min(t_ns, ring.t_ns[at])
        turn_into(q, (end_ns - at_ns) * 1e-9 * rate, turned)
        copy_into(turned, q)
        at_ns = end_ns
        number += 1


@kernel
def predicted(bodies: Rows[Body], i: int, t_ns: int, predictions: Rows[Estimate]) -> None:
    """Position, velocity and attitude of body i at a time, from the horizon through the ring on, into its prediction.

    The rest of it is the horizon's.
    """
    # By row: a record that is passed into a kernel is read field by field first, which takes longer than the kernel.
    body, out = bodies[i], predictions[i]
    ring, r = body.inertial, np.empty((3, 3))
    copy_estimate(body.estimate, out)
    number = next_sample(ring, out.t_ns)
    while out.t_ns < t_ns:
        force, rate, end_ns = np.zeros(3), np.zeros(3), t_ns
        known = number < ring.count
        if ring.count > 0:
            at = min(number, ring.count - 1) % SAMPLES
            end_ns = min(t_ns, ring.t_ns[at]) if known else t_ns
            copy_into(ring.force_flu_m_s2[at], force)
            copy_into(ring.rate_flu_rad_s[at], rate)
        if not isfinite(force[0]) or ring.count == 0:
            model_force(body, out.thrust_m_s2, force)
        move(out, force, rate, (end_ns - out.t_ns) * 1e-9, r)
        out.t_ns = end_ns
        number += 1

"""One vehicle, one frame: what each part of the estimator does to its own row of the memory. Kernels only."""

from math import atan2, exp, sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from formation.estimation.fteso import activity, extrapolation_error, fteso_step, rate_step, wrapped
from formation.maths.arrays import Float
from formation.maths.kernel import kernel
from formation.vehicle.body import GRAVITY_M_S2
from formation.vehicle.response import SECONDS, answer

STRENGTH_LAG, ATTITUDE_TRUST, TILT_W, TILT_DECAY, QUIET, QUIET_TURN, TURN_TRUST, VIGILANCE = range(8)
"""Columns of EstimatorSettings.manner; Vigilance follows: lag, threshold, most, bandwidth power, habit."""
LAG, THRESHOLD, MOST, POWER, HABIT = range(VIGILANCE, VIGILANCE + 5)

DIST_MAX_M_S2 = 14.0
STRENGTH_LOW, STRENGTH_HIGH = 0.5, 2.0
NOISE_LEAST_M, NOISE_LAG_S, NOISE_SPAN_S = 2e-5, 0.5, 0.2  # least believed, how slowly learned, from how close frames
NOISE_POWER, HABIT_LAG_S = 0.35, 3.0
MISFIT_LAG_S, MISFIT_RATE_M_S3 = 2.0, 3.0  # over how long it is judged; turns as slow as this say little
MISFIT_FAIR, MISFIT_BAD, SHIFT_MOST = 0.45, 0.55, 0.3
TRIM_LAG_S, TRIM_MAX_M_S2 = 0.5, 1.0


class Memory(NamedTuple):
    """The arrays of an EstimatorState, as kernels pass them on."""

    pos: Float
    vel: Float
    dist: Float
    force: Float
    lift: Float
    strength: Float
    heading: Float
    q: Float
    tilt: Float
    force_rate: Float
    innovation: Float
    surprise_m2: Float
    mu: Float
    mu_turn: Float
    noise_m2: Float
    recent_m: Float
    recent_ns: NDArray[np.int64]
    believed: Float
    trim: Float
    missed: Float
    misfit: Float
    shift_s: Float


@kernel
def thrust_axis(q: Float) -> tuple[float, float, float]:
    """The body's z axis in `lab`, along which the rotors pull; q: q_lab_from_flu (4)."""
    qw, qx, qy, qz = q[0], q[1], q[2], q[3]
    return 2.0 * (qx * qz + qw * qy), 2.0 * (qy * qz - qw * qx), 1.0 - 2.0 * (qx * qx + qy * qy)


@kernel
def rebuild_force(
    i: int, z: Memory, from_ns: int, to_ns: int, seen: bool, manner: Float, response: Float,
    sent_ns: NDArray[np.int64], sent: Float,
) -> None:  # fmt: skip
    """Force and lift at to_ns: delivered thrust along the body's z, modelled, then corrected by the measured one.

    sent (h, 4): this vehicle's own history.
    """
    upward, speed, travel = np.empty(2), np.empty(2), np.empty(2)
    upward[0], upward[1] = z.force[i, 2], z.lift[i]
    answer(sent_ns, sent[:, 0:2], from_ns, to_ns, response[0], response[1], z.force[i, 0:2], speed, travel)
    answer(sent_ns, sent[:, 2:4], from_ns, to_ns, response[2], response[3], upward, speed, travel)
    z.force[i, 2], z.lift[i] = upward[0], upward[1]
    if not seen:
        return
    along = thrust_axis(z.q[i])
    trust = manner[ATTITUDE_TRUST]
    for axis in range(2):
        z.force[i, axis] += trust * (z.lift[i] * along[axis] - z.trim[i, axis] - z.force[i, axis])
    z.force[i, 2] = z.lift[i] * along[2]


@kernel
def judge_answer(
    i: int, z: Memory, from_ns: int, to_ns: int, seen: bool, belief: Float, sent_ns: NDArray[np.int64], sent: Float
) -> None:
    """How much earlier, and how far otherwise, a vehicle answers than its profile says: its shift and its misfit.

    What the profile's response alone, belief (2: dead time, lag, s), makes of the commands is held against the force
    measured. The part of the miss that goes with the believed rate of change is a shift in time, counted on up to
    SHIFT_MOST of the response's length; the rest over that rate and that length is the misfit. Noise and a plainly
    slower vehicle show little; one that swings because its motors cannot follow shows 0.6 and more, and no shift.
    """
    speed, travel, before = np.empty(2), np.empty(2), z.believed[i].copy()
    answer(sent_ns, sent[:, 0:2], from_ns, to_ns, belief[0], belief[1], z.believed[i], speed, travel)
    if not seen:
        return
    along = thrust_axis(z.q[i])
    dt_s = (to_ns - from_ns) * SECONDS
    rate2, miss2, both = 0.0, 0.0, 0.0
    for axis in range(2):
        rate = (z.believed[i, axis] - before[axis]) / dt_s
        miss = learn_trim(i, axis, z, z.lift[i] * along[axis] - z.believed[i, axis], rate, dt_s)
        rate2, miss2, both = rate2 + rate * rate, miss2 + miss * miss, both + miss * rate
    share = 1.0 - exp(-dt_s / MISFIT_LAG_S)
    z.missed[i, 0] += share * (rate2 - z.missed[i, 0])
    z.missed[i, 1] += share * (miss2 - z.missed[i, 1])
    z.missed[i, 2] += share * (both - z.missed[i, 2])
    turned = z.missed[i, 0] + MISFIT_RATE_M_S3 * MISFIT_RATE_M_S3
    shift_s, length_s = z.missed[i, 2] / turned, belief[0] + belief[1]
    z.misfit[i] = sqrt(max(z.missed[i, 1] / turned - shift_s * shift_s, 0.0)) / length_s
    most = (1.0 - doubt(z.misfit[i])) * SHIFT_MOST * length_s
    z.shift_s[i] = min(max(shift_s, -most), most)


@kernel
def learn_trim(i: int, axis: int, z: Memory, miss: float, rate: float, dt_s: float) -> float:
    """Moves the lasting part of a miss, m/s^2, out of the force into Z3; the sum of both stays as it is. The rest.

    An autopilot is level by its own estimate, which wanders by a degree about the truth that a mocap sees: such a lean
    answers no command, so it is a disturbance of the commands, and no part of the answer to them. Of a vehicle that is
    being turned fast little is learned: what it misses then may well be an answer.
    """
    known: float = z.trim[i, axis]
    calm = 1.0 / (1.0 + max(z.missed[i, 0], rate * rate) / (MISFIT_RATE_M_S3 * MISFIT_RATE_M_S3))
    learned: float = known + calm * (1.0 - exp(-dt_s / TRIM_LAG_S)) * (miss - known)
    learned = min(max(learned, -TRIM_MAX_M_S2), TRIM_MAX_M_S2)
    moved = learned - known
    z.trim[i, axis] = learned
    z.force[i, axis] -= moved
    z.dist[i, axis] += z.strength[i] * moved
    return miss - learned


@kernel
def doubt(misfit: float) -> float:
    """How little a vehicle is believed to be what its profile says, 0..1."""
    return min(max((misfit - MISFIT_FAIR) / (MISFIT_BAD - MISFIT_FAIR), 0.0), 1.0)


@kernel
def observe_tilt(i: int, z: Memory, seen: bool, dt_s: float, manner: Float) -> None:
    """The horizontal force of a quadcopter that is only observed: its tilt times gravity and its own rise."""
    lift = max(GRAVITY_M_S2 + z.dist[i, 2], 0.0)
    forward, left, upward = thrust_axis(z.q[i])
    up = max(upward, 0.3)
    measured = (forward / up, left / up)
    w = manner[TILT_W] * z.mu[i] ** manner[POWER]
    for axis in range(2):
        if seen:
            z.tilt[i, axis], z.tilt[i, 2 + axis] = rate_step(
                z.tilt[i, axis], z.tilt[i, 2 + axis], measured[axis], dt_s, w, manner[TILT_DECAY]
            )
        z.force[i, axis] = z.tilt[i, axis] * lift
        z.force_rate[i, axis] = z.tilt[i, 2 + axis] * lift


@kernel
def learn_noise(i: int, z: Memory, to_ns: int, pos_measured: Float) -> None:
    """Learns the variance of the measured position from what smooth motion cannot explain."""
    span_s = (to_ns - z.recent_ns[i, 0]) * SECONDS
    if span_s < NOISE_SPAN_S:
        times = np.zeros(3)
        for k in range(3):
            times[k] = (z.recent_ns[i, k] - to_ns) * SECONDS
        square, gain = 0.0, 1.0
        for axis in range(3):
            error, gain = extrapolation_error(times, z.recent_m[i, :, axis], 0.0, pos_measured[i, axis])
            square += error * error / gain
        share = min(span_s / (3.0 * NOISE_LAG_S), 1.0)
        z.noise_m2[i] += share * (min(square / 3.0, 9.0 * z.noise_m2[i]) - z.noise_m2[i])
        z.noise_m2[i] = max(z.noise_m2[i], NOISE_LEAST_M * NOISE_LEAST_M)
    for k in range(3):
        z.recent_ns[i, k] = z.recent_ns[i, k + 1] if k < 2 else to_ns
        for axis in range(3):
            z.recent_m[i, k, axis] = z.recent_m[i, k + 1, axis] if k < 2 else pos_measured[i, axis]


@kernel
def watch(i: int, z: Memory, pos_measured: Float, model: Float, dt_s: float, own: bool, manner: Float) -> None:
    """Filters the innovation and sets the activity: one for both horizontal axes, so that turning changes nothing.

    A vehicle that is only observed has no model of its climbing either: there the height counts too.
    """
    share = 1.0 - exp(-dt_s / manner[LAG])
    square = 0.0
    for axis in range(2 if own else 3):
        ahead = z.pos[i, axis] + dt_s * (z.vel[i, axis] + 0.5 * dt_s * (model[axis] + z.dist[i, axis]))
        z.innovation[i, axis] += share * (pos_measured[i, axis] - ahead - z.innovation[i, axis])
        square += z.innovation[i, axis] * z.innovation[i, axis]
    z.surprise_m2[i] += (1.0 - exp(-dt_s / HABIT_LAG_S)) * (square - z.surprise_m2[i])
    noise = manner[THRESHOLD] * manner[THRESHOLD] * z.noise_m2[i] * dt_s / (2.0 * manner[LAG] + dt_s)
    z.mu[i] = activity(sqrt(square), sqrt(noise + manner[HABIT] * z.surprise_m2[i]), manner[MOST])


@kernel
def observe_axis(
    i: int, axis: int, z: Memory, measured: float, seen: bool, model: float, dt_s: float, wide: bool, manner: Float,
    gains: Float,
) -> None:  # fmt: skip
    """One axis's FTESO, its bandwidth less in noise and, where `wide`, more in activity; unseen, the model alone."""
    z1, z2, z3 = z.pos[i, axis], z.vel[i, axis], z.dist[i, axis]
    if seen:
        w = gains[0] * min(manner[QUIET] / sqrt(z.noise_m2[i]), 1.0) ** NOISE_POWER
        if wide:
            w *= z.mu[i] ** manner[POWER]
        z1, z2, z3 = fteso_step(z1, z2, z3, model, measured, dt_s, w, gains[1], gains[2], gains[3])
    else:
        z1 += dt_s * z2 + 0.5 * dt_s * dt_s * (model + z3)
        z2 += dt_s * (model + z3)
    z.pos[i, axis], z.vel[i, axis] = z1, z2
    z.dist[i, axis] = min(max(z3, -DIST_MAX_M_S2), DIST_MAX_M_S2)


@kernel
def learn_strength(i: int, z: Memory, dt_s: float, manner: Float) -> None:
    """Moves what Z3 holds against gravity slowly into the thrust's strength; the sum of both stays as it is."""
    share = dt_s / (manner[STRENGTH_LAG] + dt_s)
    learned = z.strength[i] + share * z.dist[i, 2] / z.force[i, 2]
    learned = min(max(learned, STRENGTH_LOW), STRENGTH_HIGH)
    moved = learned - z.strength[i]
    z.strength[i] = learned
    for axis in range(3):
        z.dist[i, axis] -= moved * z.force[i, axis]


@kernel
def observe_heading(
    i: int, z: Memory, seen: bool, dt_s: float, turn: float, own: bool, manner: Float, gains: Float
) -> None:
    """Advances the heading: angle (unwrapped), rate, and what the turn asked for misses of its acceleration."""
    psi, rate, more = z.heading[i, 0], z.heading[i, 1], z.heading[i, 2]
    ahead = psi + dt_s * rate + 0.5 * dt_s * dt_s * (turn + more)
    if not seen:
        z.heading[i, 0], z.heading[i, 1], z.heading[i, 2] = ahead, rate + dt_s * turn, 0.0
        return
    qw, qx, qy, qz = z.q[i, 0], z.q[i, 1], z.q[i, 2], z.q[i, 3]
    missed = wrapped(atan2(2.0 * (qw * qz + qx * qy), 1.0 - 2.0 * (qy * qy + qz * qz)) - ahead)
    w = gains[0]
    if not own:
        z.innovation[i, 3] += (1.0 - exp(-dt_s / manner[LAG])) * (missed - z.innovation[i, 3])
        noise = manner[THRESHOLD] * manner[QUIET_TURN] * sqrt(dt_s / (2.0 * manner[LAG] + dt_s))
        z.mu_turn[i] = activity(z.innovation[i, 3], noise, manner[MOST])
        w *= z.mu_turn[i] ** manner[POWER]
    z.heading[i, 0], z.heading[i, 1], z.heading[i, 2] = fteso_step(
        psi, rate, more, turn, ahead + missed, dt_s, w, gains[1], gains[2], gains[3]
    )

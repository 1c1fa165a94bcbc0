"""The observers: position, velocity and disturbance of every vehicle, heading, and how strong its thrust really is.

One finite-time extended state observer (FTESO, Eqs. 3-4) per axis, stepped implicitly so that it is stable at any
frame rate. It is fed the acceleration rebuilt from the measured attitude and the thrust delivered so far; fed the
commanded acceleration instead, Z3 would fight the vehicle's own lag.
"""

from dataclasses import dataclass
from math import atan2, exp, sqrt

import numpy as np
from numpy.typing import NDArray

from formation import frames
from formation.arrays import Flags, Float, Quats, Scalars, Vec3s
from formation.kernel import kernel
from formation.messages import MocapFrame, SwarmState
from formation.observer import activity, extrapolation_error, fteso_step, rate_step, wrapped
from formation.response import NEVER_NS, SECONDS, History, answer
from formation.rigid_body import GRAVITY_M_S2

STRENGTH_LAG, ATTITUDE_TRUST, TILT_W, TILT_DECAY, QUIET, TURN_TRUST, VIGILANCE = range(7)
DIST_MAX_M_S2 = 14.0
STRENGTH_LOW, STRENGTH_HIGH = 0.5, 2.0
NOISE_M, NOISE_LEAST_M = 2e-4, 2e-5  # position noise: first guess, and the least believed
NOISE_LAG_S, NOISE_SPAN_S = 0.5, 0.2  # how slowly it is learned, and how close together the frames must be
NOISE_POWER, HABIT_LAG_S = 0.35, 3.0


@dataclass(frozen=True, slots=True)
class ObserverGains:
    """w and a of Eqs. (3)-(4), and the error scale e0 that gives the fractional powers a natural length.

    Corrections are e0 sig(e / e0)^(1 + i a): at |e| = e0 the bandwidth is w. The paper's own is e0 = 1 m.
    smooth rounds the powers off below |e| = smooth e0, so that noise alone never sees more than about w.
    """

    bandwidth_rad_s: float
    alpha: float
    scale: float
    smooth: float = 1.0


@dataclass(frozen=True, slots=True)
class Vigilance:
    """When the horizontal observers wake up: while the innovation, filtered over lag_s, exceeds what is expected.

    mu = sqrt(1 + innovation^2 / (threshold^2 noise^2 + habit * mean)), at most `most`: noise is what the measurement's
    own noise leaves in the filter, mean the innovation's mean square over some seconds, so that a lasting
    oscillation calms the loop instead of exciting it. mu^bandwidth_power multiplies the bandwidth (and powers of it
    the law's gains); most = 1 switches it off.
    """

    lag_s: float = 0.05
    threshold: float = 3.0
    most: float = 1.0
    bandwidth_power: float = 1.0
    habit: float = 0.15


@dataclass(frozen=True, slots=True, eq=False)
class EstimatorSettings:
    """Per vehicle, (n) or (n, k): observer rows are bandwidth, alpha, scale, smooth.

    own: index among the commanded vehicles, or -1 for one that is only observed.
    response: attitude dead time, attitude lag, thrust dead time, thrust lag, s.
    manner (n, 11): columns STRENGTH_LAG (how slowly Z3 of the height moves into the thrust's strength, s),
    ATTITUDE_TRUST (share of the measured tilt, against the modelled one, that a frame is given), TILT_W and TILT_DECAY
    (filter of an observed vehicle's tilt and of its rate; 0: its attitude is not used), QUIET (position noise, m, above
    which bandwidths shrink), TURN_TRUST (how much of an observed heading's Z3 is taken to last), and from VIGILANCE on
    the fields of Vigilance.
    """

    horizontal: Float
    vertical: Float
    heading: Float
    response: Float
    own: NDArray[np.int64]
    manner: Float


@dataclass(frozen=True, slots=True, eq=False)
class EstimatorState:
    """What the observers remember of the n vehicles at capture time t_ns.

    force: modelled specific force in `lab` at t_ns, before `strength`; lift_m_s2: its length, the thrust delivered;
    strength: true thrust per modelled thrust (mass, battery, propellers); heading: angle, rate and Z3 of the heading;
    tilt (n, 4): of a vehicle that is only observed, horizontal over vertical force, x and y, then their rates;
    force_rate: the turn of its force; innovation (n, 2): horizontal, filtered; surprise_m2: its mean
    square; activity: see Vigilance;
    noise_m2: learned variance of the measured position; recent_m (n, 3, 3), recent_ns (n, 3): the last three seen.
    """

    t_ns: int
    pos_lab_m: Vec3s
    vel_lab_m_s: Vec3s
    dist_lab_m_s2: Vec3s
    force_lab_m_s2: Vec3s
    lift_m_s2: Scalars
    strength: Scalars
    heading: Vec3s
    q_lab_from_flu: Quats
    seen_ns: NDArray[np.int64]
    tilt: Float
    force_rate: Vec3s
    innovation: Float
    surprise_m2: Scalars
    activity: Scalars
    noise_m2: Scalars
    recent_m: Float
    recent_ns: NDArray[np.int64]


def initial(frame: MocapFrame, flying: Flags) -> EstimatorState:
    """All at rest where the first frame sees them; flying (n): commanded ones that hover there already."""
    n = len(frame.bodies)
    lift = np.where(flying, GRAVITY_M_S2, 0.0)
    force = np.zeros((n, 3))
    force[:, 2] = lift
    heading = np.zeros((n, 3))
    heading[:, 0] = frames.yaw(frame.q_lab_from_flu)
    return EstimatorState(
        t_ns=frame.t_capture_ns,
        pos_lab_m=frame.pos_lab_m.copy(),
        vel_lab_m_s=np.zeros((n, 3)),
        dist_lab_m_s2=np.zeros((n, 3)),
        force_lab_m_s2=force,
        lift_m_s2=lift,
        strength=np.ones(n),
        heading=heading,
        q_lab_from_flu=frame.q_lab_from_flu.copy(),
        seen_ns=np.full(n, frame.t_capture_ns, dtype=np.int64),
        tilt=np.zeros((n, 4)),
        force_rate=np.zeros((n, 3)),
        innovation=np.zeros((n, 2)),
        surprise_m2=np.zeros(n),
        activity=np.ones(n),
        noise_m2=np.full(n, NOISE_M**2),
        recent_m=np.repeat(frame.pos_lab_m[:, None, :], 3, axis=1),
        recent_ns=np.full((n, 3), NEVER_NS, dtype=np.int64),
    )


def estimate(
    state: EstimatorState, settings: EstimatorSettings, frame: MocapFrame, history: History, airborne: Flags,
    turn_rad_s2: Scalars,
) -> EstimatorState:  # fmt: skip
    """The observers after one more frame of the same n bodies; a frame that is not newer changes nothing.

    airborne (n): where not, the thrust's strength is not learned (the floor carries part of the weight).
    turn_rad_s2 (n): angular acceleration of the heading that was asked for; zero where nobody asks.
    """
    if frame.t_capture_ns <= state.t_ns:
        return state
    new = EstimatorState(
        frame.t_capture_ns, state.pos_lab_m.copy(), state.vel_lab_m_s.copy(), state.dist_lab_m_s2.copy(),
        state.force_lab_m_s2.copy(), state.lift_m_s2.copy(), state.strength.copy(), state.heading.copy(),
        state.q_lab_from_flu.copy(), state.seen_ns.copy(), state.tilt.copy(), state.force_rate.copy(),
        state.innovation.copy(), state.surprise_m2.copy(), state.activity.copy(), state.noise_m2.copy(),
        state.recent_m.copy(), state.recent_ns.copy(),
    )  # fmt: skip
    _observe(
        state.t_ns, frame.t_capture_ns, frame.pos_lab_m, frame.q_lab_from_flu, frame.seen, airborne, turn_rad_s2,
        settings.horizontal, settings.vertical, settings.heading, settings.response, settings.own,
        settings.manner, history.t_ns, history.force,
        new.pos_lab_m, new.vel_lab_m_s, new.dist_lab_m_s2, new.force_lab_m_s2, new.lift_m_s2, new.strength,
        new.heading, new.q_lab_from_flu, new.seen_ns, new.tilt, new.force_rate, new.innovation, new.surprise_m2,
        new.activity, new.noise_m2, new.recent_m, new.recent_ns,
    )  # fmt: skip
    return new


def swarm_state(state: EstimatorState, settings: EstimatorSettings, turn_rad_s2: Scalars) -> SwarmState:
    """The estimate as the message that is logged and shown; turn_rad_s2 (n) as in `estimate`."""
    acc = state.strength[:, None] * state.force_lab_m_s2 + state.dist_lab_m_s2
    acc[:, 2] -= np.where(settings.own >= 0, GRAVITY_M_S2, 0.0)
    turning = np.where(settings.own >= 0, 1.0, settings.manner[:, TURN_TRUST]) * state.heading[:, 2] + turn_rad_s2
    age_s = np.asarray((state.t_ns - state.seen_ns) * SECONDS, dtype=np.float64)
    return SwarmState(
        state.t_ns, state.pos_lab_m, state.vel_lab_m_s, state.dist_lab_m_s2, acc, state.q_lab_from_flu,
        state.heading[:, 0], state.heading[:, 1], turning, age_s,
    )  # fmt: skip


@kernel
def _observe(
    from_ns: int, to_ns: int, pos_measured: Float, q_measured: Float, seen: NDArray[np.bool_],
    airborne: NDArray[np.bool_], turn: Float, horizontal: Float, vertical: Float, yaw_gains: Float, response: Float,
    own: NDArray[np.int64], manner: Float, sent_ns: NDArray[np.int64], sent: Float,
    pos: Float, vel: Float, dist: Float, force: Float, lift: Float, strength: Float, heading: Float, q: Float,
    seen_ns: NDArray[np.int64], tilt: Float, force_rate: Float, innovation: Float, surprise_m2: Float, mu: Float,
    noise_m2: Float, recent_m: Float, recent_ns: NDArray[np.int64],
) -> None:  # fmt: skip
    """One frame for all n vehicles, in place; see `estimate`."""
    dt_s = (to_ns - from_ns) * SECONDS
    model = np.zeros(3)
    for i in range(len(own)):
        if seen[i]:
            for k in range(4):
                q[i, k] = q_measured[i, k]
            seen_ns[i] = to_ns
        for axis in range(3):
            model[axis] = 0.5 * force[i, axis]
        if own[i] >= 0:
            mine = sent[:, own[i]]
            _rebuild_force(
                i, from_ns, to_ns, q, seen[i], manner[i, ATTITUDE_TRUST], response, sent_ns, mine, force, lift
            )
        elif manner[i, TILT_W] > 0.0:
            _observe_tilt(
                i, q, seen[i], dt_s, manner[i, TILT_W], manner[i, TILT_DECAY], dist[i, 2], tilt, force, force_rate
            )
        for axis in range(3):
            model[axis] = strength[i] * (model[axis] + 0.5 * force[i, axis])
        if own[i] >= 0:
            model[2] -= GRAVITY_M_S2
        if seen[i]:
            _learn_noise(i, to_ns, pos_measured, recent_m, recent_ns, noise_m2)
            _watch(
                i,
                pos_measured,
                pos,
                vel,
                dist,
                model,
                dt_s,
                manner[i, VIGILANCE:],
                noise_m2,
                innovation,
                surprise_m2,
                mu,
            )
        calm = min(manner[i, QUIET] / sqrt(noise_m2[i]), 1.0) ** NOISE_POWER
        for axis in range(3):
            gains = vertical[i] if axis == 2 else horizontal[i]
            z1, z2, z3 = pos[i, axis], vel[i, axis], dist[i, axis]
            if seen[i]:
                w = gains[0] * calm if axis == 2 else gains[0] * calm * mu[i] ** manner[i, VIGILANCE + 3]
                z1, z2, z3 = fteso_step(
                    z1, z2, z3, model[axis], pos_measured[i, axis], dt_s, w, gains[1], gains[2], gains[3]
                )
            else:
                z1 += dt_s * z2 + 0.5 * dt_s * dt_s * (model[axis] + z3)
                z2 += dt_s * (model[axis] + z3)
            pos[i, axis], vel[i, axis] = z1, z2
            dist[i, axis] = min(max(z3, -DIST_MAX_M_S2), DIST_MAX_M_S2)
        if airborne[i] and own[i] >= 0 and seen[i] and force[i, 2] > 0.3 * GRAVITY_M_S2:
            _learn_strength(i, dt_s, manner[i, STRENGTH_LAG], force, strength, dist)
        _observe_heading(i, q, seen[i], dt_s, turn[i], yaw_gains, heading)


@kernel
def _rebuild_force(
    i: int, from_ns: int, to_ns: int, q: Float, seen: bool, trust: float, response: Float,
    sent_ns: NDArray[np.int64], sent: Float, force: Float, lift: Float,
) -> None:  # fmt: skip
    """force[i], lift[i] at to_ns: delivered thrust along the body's z, modelled, then corrected by the measured one.

    sent (h, 4): this vehicle's own history; trust: share of the measurement in the correction.
    """
    lift[i], _, _ = answer(sent_ns, sent[:, 3], from_ns, to_ns, response[i, 2], response[i, 3], lift[i])
    for axis in range(3):
        dead, lag = (response[i, 0], response[i, 1]) if axis < 2 else (response[i, 2], response[i, 3])
        force[i, axis], _, _ = answer(sent_ns, sent[:, axis], from_ns, to_ns, dead, lag, force[i, axis])
    if not seen:
        return
    w, x, y, z = q[i, 0], q[i, 1], q[i, 2], q[i, 3]
    force[i, 0] += trust * (lift[i] * 2.0 * (x * z + w * y) - force[i, 0])
    force[i, 1] += trust * (lift[i] * 2.0 * (y * z - w * x) - force[i, 1])
    force[i, 2] = lift[i] * (1.0 - 2.0 * (x * x + y * y))


@kernel
def _observe_tilt(
    i: int, q: Float, seen: bool, dt_s: float, w: float, decay_1_s: float, rise_m_s2: float,
    tilt: Float, force: Float, force_rate: Float,
) -> None:  # fmt: skip
    """The horizontal force of a quadcopter that is only observed: its tilt times gravity and its own rise."""
    lift = max(GRAVITY_M_S2 + rise_m_s2, 0.0)
    qw, x, y, z = q[i, 0], q[i, 1], q[i, 2], q[i, 3]
    up = max(1.0 - 2.0 * (x * x + y * y), 0.3)
    measured = (2.0 * (x * z + qw * y) / up, 2.0 * (y * z - qw * x) / up)
    for axis in range(2):
        if seen:
            tilt[i, axis], tilt[i, 2 + axis] = rate_step(
                tilt[i, axis], tilt[i, 2 + axis], measured[axis], dt_s, w, decay_1_s
            )
        force[i, axis] = tilt[i, axis] * lift
        force_rate[i, axis] = tilt[i, 2 + axis] * lift


@kernel
def _learn_noise(
    i: int, to_ns: int, pos_measured: Float, recent_m: Float, recent_ns: NDArray[np.int64], noise_m2: Float
) -> None:
    """Learns the variance of the measured position from what smooth motion cannot explain."""
    span_s = (to_ns - recent_ns[i, 0]) * SECONDS
    if span_s < NOISE_SPAN_S:
        times = np.zeros(3)
        for k in range(3):
            times[k] = (recent_ns[i, k] - to_ns) * SECONDS
        square, gain = 0.0, 1.0
        for axis in range(3):
            error, gain = extrapolation_error(times, recent_m[i, :, axis], 0.0, pos_measured[i, axis])
            square += error * error / gain
        share = min(span_s / (3.0 * NOISE_LAG_S), 1.0)
        noise_m2[i] += share * (min(square / 3.0, 9.0 * noise_m2[i]) - noise_m2[i])
        noise_m2[i] = max(noise_m2[i], NOISE_LEAST_M * NOISE_LEAST_M)
    for k in range(3):
        recent_ns[i, k] = recent_ns[i, k + 1] if k < 2 else to_ns
        for axis in range(3):
            recent_m[i, k, axis] = recent_m[i, k + 1, axis] if k < 2 else pos_measured[i, axis]


@kernel
def _watch(
    i: int, pos_measured: Float, pos: Float, vel: Float, dist: Float, model: Float, dt_s: float, vigilance: Float,
    noise_m2: Float, innovation: Float, surprise_m2: Float, mu: Float,
) -> None:  # fmt: skip
    """Filters the horizontal innovation and sets the activity; one for both axes, so that turning changes nothing."""
    share = 1.0 - exp(-dt_s / vigilance[0])
    for axis in range(2):
        ahead = pos[i, axis] + dt_s * (vel[i, axis] + 0.5 * dt_s * (model[axis] + dist[i, axis]))
        innovation[i, axis] += share * (pos_measured[i, axis] - ahead - innovation[i, axis])
    square = innovation[i, 0] * innovation[i, 0] + innovation[i, 1] * innovation[i, 1]
    surprise_m2[i] += (1.0 - exp(-dt_s / HABIT_LAG_S)) * (square - surprise_m2[i])
    noise = vigilance[1] * vigilance[1] * noise_m2[i] * dt_s / (2.0 * vigilance[0] + dt_s)
    mu[i] = activity(sqrt(square), sqrt(noise + vigilance[4] * surprise_m2[i]), vigilance[2])


@kernel
def _learn_strength(i: int, dt_s: float, lag_s: float, force: Float, strength: Float, dist: Float) -> None:
    """Moves what Z3 holds against gravity slowly into the thrust's strength; the sum of both stays as it is."""
    share = dt_s / (lag_s + dt_s)
    learned = strength[i] + share * dist[i, 2] / force[i, 2]
    learned = min(max(learned, STRENGTH_LOW), STRENGTH_HIGH)
    moved = learned - strength[i]
    strength[i] = learned
    for axis in range(3):
        dist[i, axis] -= moved * force[i, axis]


@kernel
def _observe_heading(i: int, q: Float, seen: bool, dt_s: float, turn: float, gains: Float, heading: Float) -> None:
    """Advances heading[i] (angle, rate, what the turn asked for misses of its acceleration); the angle is unwrapped."""
    psi, rate, more = heading[i, 0], heading[i, 1], heading[i, 2]
    ahead = psi + dt_s * rate + 0.5 * dt_s * dt_s * (turn + more)
    if seen:
        w, x, y, z = q[i, 0], q[i, 1], q[i, 2], q[i, 3]
        measured = atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
        y_psi = ahead + wrapped(measured - ahead)
        psi, rate, more = fteso_step(
            psi, rate, more, turn, y_psi, dt_s, gains[i, 0], gains[i, 1], gains[i, 2], gains[i, 3]
        )
    else:
        psi, rate, more = ahead, rate + dt_s * turn, 0.0
    heading[i, 0], heading[i, 1], heading[i, 2] = psi, rate, more

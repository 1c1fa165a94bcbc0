"""The observers: position, velocity and disturbance of every vehicle, heading, and how strong its thrust really is.

One finite-time extended state observer (FTESO, Eqs. 3-4) per axis, stepped implicitly so that it is stable at any
frame rate. It is fed the acceleration rebuilt from the measured attitude and the thrust delivered so far; fed the
commanded acceleration instead, Z3 would fight the vehicle's own lag.
"""

from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from formation.estimation.update import (
    TILT_W,
    TURN_TRUST,
    Memory,
    judge_answer,
    learn_noise,
    learn_strength,
    observe_axis,
    observe_heading,
    observe_tilt,
    rebuild_force,
    watch,
)
from formation.maths import frames
from formation.maths.arrays import Flags, Float, Quats, Scalars, Vec3s
from formation.maths.kernel import kernel
from formation.messages import LabFrame, SwarmState
from formation.vehicle.body import GRAVITY_M_S2
from formation.vehicle.response import NEVER_NS, SECONDS, History

NOISE_M = 2e-4  # the first guess of a position's noise


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

    def paced(self, pace: float) -> "ObserverGains":
        """The same observer, its bandwidth multiplied by `pace`."""
        return replace(self, bandwidth_rad_s=pace * self.bandwidth_rad_s)


@dataclass(frozen=True, slots=True)
class Vigilance:
    """When observers wake up: while the innovation, filtered over lag_s, exceeds what is expected.

    mu = sqrt(1 + innovation^2 / (threshold^2 noise^2 + habit * mean)), at most `most`: noise is what the measurement's
    own noise leaves in the filter, mean the innovation's mean square over some seconds, so that a lasting
    oscillation calms the loop instead of exciting it. mu^bandwidth_power multiplies the bandwidth (and powers of it
    the law's gains); most = 1 switches it off. One mu serves both horizontal axes; of a vehicle that is only
    observed it serves all axes and the tilt, and its heading has one of its own.
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
    manner (n, 12): columns STRENGTH_LAG (how slowly Z3 of the height moves into the thrust's strength, s),
    ATTITUDE_TRUST (share of the measured tilt, against the modelled one, that a frame is given), TILT_W and TILT_DECAY
    (filter of an observed vehicle's tilt and of its rate; 0: its attitude is not used), QUIET (position noise, m, above
    which bandwidths shrink), QUIET_TURN (heading noise, rad, that surprises nobody), TURN_TRUST (how much of an
    observed heading's Z3 is taken to last), and from VIGILANCE on the fields of Vigilance.
    belief (n, 2): dead time and lag of the attitude in full, as the profile has them, s.
    """

    horizontal: Float
    vertical: Float
    heading: Float
    response: Float
    own: NDArray[np.int64]
    manner: Float
    belief: Float


@dataclass(frozen=True, slots=True, eq=False)
class EstimatorState:
    """What the observers remember of the n vehicles at capture time t_ns.

    force: modelled specific force in `lab` at t_ns, before `strength`; lift_m_s2: its length, the thrust delivered;
    strength: true thrust per modelled thrust (mass, battery, propellers); heading: angle, rate and Z3 of the heading;
    tilt (n, 4): of a vehicle that is only observed, horizontal over vertical force, x and y, then their rates;
    force_rate: the turn of its force; innovation (n, 4): position and heading, filtered;
    surprise_m2: its horizontal
    mean square; activity, turn_activity: see Vigilance;
    noise_m2: learned variance of the measured position; recent_m (n, 3, 3), recent_ns (n, 3): the last three seen;
    believed (n, 2): horizontal force if the vehicle answered as its profile says; trim (n, 2): what the measured force
    lastingly misses of it; missed (n, 3): mean squares of its rate and of what the measured force misses besides, and
    their mean product; misfit, shift_s: formation.estimation.update.
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
    turn_activity: Scalars
    noise_m2: Scalars
    recent_m: Float
    recent_ns: NDArray[np.int64]
    believed: Float
    trim: Float
    missed: Float
    misfit: Scalars
    shift_s: Scalars


def initial(frame: LabFrame, flying: Flags) -> EstimatorState:
    """All at rest where the first frame sees them; flying (n): commanded ones that hover there already.

    A body that the frame does not see is nowhere yet: it begins with the first frame that does.
    """
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
        seen_ns=np.where(frame.seen, frame.t_capture_ns, NEVER_NS),
        tilt=np.zeros((n, 4)),
        force_rate=np.zeros((n, 3)),
        innovation=np.zeros((n, 4)),
        surprise_m2=np.zeros(n),
        activity=np.ones(n),
        turn_activity=np.ones(n),
        noise_m2=np.full(n, NOISE_M**2),
        recent_m=np.repeat(frame.pos_lab_m[:, None, :], 3, axis=1),
        recent_ns=np.full((n, 3), NEVER_NS, dtype=np.int64),
        believed=np.zeros((n, 2)),
        trim=np.zeros((n, 2)),
        missed=np.zeros((n, 3)),
        misfit=np.zeros(n),
        shift_s=np.zeros(n),
    )


def estimate(
    state: EstimatorState, settings: EstimatorSettings, frame: LabFrame, history: History, airborne: Flags,
    turn_rad_s2: Scalars,
) -> EstimatorState:  # fmt: skip
    """The observers after one more frame of the same n bodies; a frame that is not newer changes nothing.

    airborne (n): where not, the thrust's strength is not learned (the floor carries part of the weight).
    turn_rad_s2 (n): angular acceleration of the heading that was asked for; zero where nobody asks.
    """
    if frame.t_capture_ns <= state.t_ns:
        return state
    appearing = frame.seen & (state.seen_ns == NEVER_NS)
    if appearing.any():
        state = _begun(state, frame, appearing)
    new = EstimatorState(
        frame.t_capture_ns, state.pos_lab_m.copy(), state.vel_lab_m_s.copy(), state.dist_lab_m_s2.copy(),
        state.force_lab_m_s2.copy(), state.lift_m_s2.copy(), state.strength.copy(), state.heading.copy(),
        state.q_lab_from_flu.copy(), state.seen_ns.copy(), state.tilt.copy(), state.force_rate.copy(),
        state.innovation.copy(), state.surprise_m2.copy(), state.activity.copy(), state.turn_activity.copy(),
        state.noise_m2.copy(), state.recent_m.copy(), state.recent_ns.copy(), state.believed.copy(),
        state.trim.copy(), state.missed.copy(), state.misfit.copy(), state.shift_s.copy(),
    )  # fmt: skip
    _observe(
        state.t_ns, frame.t_capture_ns, frame.pos_lab_m, frame.q_lab_from_flu, frame.seen, airborne, turn_rad_s2,
        settings.horizontal, settings.vertical, settings.heading, settings.response, settings.own,
        settings.manner, settings.belief, history.t_ns, history.force,
        new.pos_lab_m, new.vel_lab_m_s, new.dist_lab_m_s2, new.force_lab_m_s2, new.lift_m_s2, new.strength,
        new.heading, new.q_lab_from_flu, new.seen_ns, new.tilt, new.force_rate, new.innovation, new.surprise_m2,
        new.activity, new.turn_activity, new.noise_m2, new.recent_m, new.recent_ns,
        new.believed, new.trim, new.missed, new.misfit, new.shift_s,
    )  # fmt: skip
    return new


def _begun(state: EstimatorState, frame: LabFrame, appearing: Flags) -> EstimatorState:
    """The estimate with the bodies `appearing` (n) at rest where this frame, the first to see them, has them."""
    fresh = initial(frame, state.lift_m_s2 > 0.0)
    both = ((f.name, getattr(fresh, f.name), getattr(state, f.name)) for f in fields(state) if f.name != "t_ns")
    return replace(
        state,
        **{name: np.where(appearing.reshape(-1, *(1,) * (new.ndim - 1)), new, old) for name, new, old in both},
    )


def swarm_state(state: EstimatorState, settings: EstimatorSettings, turn_rad_s2: Scalars) -> SwarmState:
    """The estimate as the message that is logged and shown; turn_rad_s2 (n) as in `estimate`."""
    n = len(settings.own)
    acc, turning, age_s = np.empty((n, 3)), np.empty(n), np.empty(n)
    _sum_up(
        state.t_ns, state.force_lab_m_s2, state.strength, state.dist_lab_m_s2, state.heading, state.seen_ns,
        settings.own, settings.manner, turn_rad_s2, acc, turning, age_s,
    )  # fmt: skip
    return SwarmState(
        state.t_ns, state.pos_lab_m, state.vel_lab_m_s, state.dist_lab_m_s2, acc, state.q_lab_from_flu,
        state.heading[:, 0], state.heading[:, 1], turning, age_s, state.misfit,
    )  # fmt: skip


@kernel
def _sum_up(
    t_ns: int, force: Float, strength: Float, dist: Float, heading: Float, seen_ns: NDArray[np.int64],
    own: NDArray[np.int64], manner: Float, turn: Float, acc: Float, turning: Float, age_s: Float,
) -> None:  # fmt: skip
    """Total acceleration (n, 3), angular acceleration of the heading (n) and age (n) of every vehicle."""
    for i in range(len(own)):
        for axis in range(3):
            acc[i, axis] = strength[i] * force[i, axis] + dist[i, axis]
        if own[i] >= 0:
            acc[i, 2] -= GRAVITY_M_S2
        turning[i] = (1.0 if own[i] >= 0 else manner[i, TURN_TRUST]) * heading[i, 2] + turn[i]
        age_s[i] = (t_ns - seen_ns[i]) * SECONDS if seen_ns[i] > NEVER_NS else np.inf


@kernel
def _observe(
    from_ns: int, to_ns: int, pos_measured: Float, q_measured: Float, seen: NDArray[np.bool_],
    airborne: NDArray[np.bool_], turn: Float, horizontal: Float, vertical: Float, yaw_gains: Float, response: Float,
    own: NDArray[np.int64], manner: Float, belief: Float, sent_ns: NDArray[np.int64], sent: Float,
    pos: Float, vel: Float, dist: Float, force: Float, lift: Float, strength: Float, heading: Float, q: Float,
    seen_ns: NDArray[np.int64], tilt: Float, force_rate: Float, innovation: Float, surprise_m2: Float, mu: Float,
    mu_turn: Float, noise_m2: Float, recent_m: Float, recent_ns: NDArray[np.int64],
    believed: Float, trim: Float, missed: Float, misfit: Float, shift_s: Float,
) -> None:  # fmt: skip
    """One frame for all n vehicles, in place; see `estimate`."""
    z = Memory(
        pos, vel, dist, force, lift, strength, heading, q, tilt, force_rate, innovation, surprise_m2, mu, mu_turn,
        noise_m2, recent_m, recent_ns, believed, trim, missed, misfit, shift_s,
    )  # fmt: skip
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
            rebuild_force(i, z, from_ns, to_ns, seen[i], manner[i], response[i], sent_ns, sent[:, own[i]])
            if airborne[i]:
                judge_answer(i, z, from_ns, to_ns, seen[i], belief[i], sent_ns, sent[:, own[i]])
        elif manner[i, TILT_W] > 0.0:
            observe_tilt(i, z, seen[i], dt_s, manner[i])
        for axis in range(3):
            model[axis] = strength[i] * (model[axis] + 0.5 * force[i, axis])
        if own[i] >= 0:
            model[2] -= GRAVITY_M_S2
            if not airborne[i]:  # the floor carries what the thrust does not
                model[2] = max(model[2], 0.0)
        if seen[i]:
            learn_noise(i, z, to_ns, pos_measured)
            watch(i, z, pos_measured, model, dt_s, own[i] >= 0, manner[i])
        for axis in range(3):
            wide = axis < 2 or own[i] < 0
            observe_axis(i, axis, z, pos_measured[i, axis], seen[i], model[axis], dt_s, wide, manner[i],
                         horizontal[i] if axis < 2 else vertical[i])  # fmt: skip
        if airborne[i] and own[i] >= 0 and seen[i] and force[i, 2] > 0.3 * GRAVITY_M_S2:
            learn_strength(i, z, dt_s, manner[i])
        observe_heading(i, z, seen[i], dt_s, turn[i], own[i] >= 0, manner[i], yaw_gains[i])

"""The observers: position, velocity and disturbance of every vehicle, heading, and how strong its thrust really is.

One finite-time extended state observer (FTESO, Eqs. 3-4) per axis, stepped implicitly so that it is stable at any
frame rate. It is fed the acceleration rebuilt from the measured attitude and the thrust delivered so far; fed the
commanded acceleration instead, Z3 would fight the vehicle's own lag.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from formation import frames
from formation.arrays import Float, Quats, Scalars, Vec3s
from formation.kernel import kernel
from formation.messages import MocapFrame, SwarmState
from formation.powers import implicit_root, sig
from formation.response import SECONDS, History, answer
from formation.rigid_body import GRAVITY_M_S2

DIST_MAX_M_S2 = 14.0
STRENGTH_LOW, STRENGTH_HIGH = 0.5, 2.0


@dataclass(frozen=True, slots=True)
class ObserverGains:
    """w and a of Eqs. (3)-(4), and the error scale e0 that gives the fractional powers a natural length.

    Corrections are e0 sig(e / e0)^(1 + i a): at |e| = e0 the bandwidth is w. The paper's own is e0 = 1 m.
    """

    bandwidth_rad_s: float
    alpha: float
    scale: float


@dataclass(frozen=True, slots=True, eq=False)
class EstimatorSettings:
    """Per vehicle, (n) or (n, k): observer rows are bandwidth, alpha, scale.

    own: index among the commanded vehicles, or -1 for one that is only observed.
    response: attitude dead time, attitude lag, thrust dead time, thrust lag, s.
    """

    horizontal: Float
    vertical: Float
    heading: Float
    response: Float
    own: NDArray[np.int64]
    strength_lag_s: float


@dataclass(frozen=True, slots=True, eq=False)
class EstimatorState:
    """What the observers remember of the n vehicles at capture time t_ns.

    force: modelled specific force in `lab` at t_ns, before `strength`; lift_m_s2: its length, the thrust delivered;
    strength: true thrust per modelled thrust (mass, battery, propellers).
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


def initial(frame: MocapFrame) -> EstimatorState:
    """All at rest where the first frame sees them."""
    n = len(frame.bodies)
    heading = np.zeros((n, 3))
    heading[:, 0] = frames.yaw(frame.q_lab_from_flu)
    return EstimatorState(
        frame.t_capture_ns, frame.pos_lab_m.copy(), np.zeros((n, 3)), np.zeros((n, 3)), np.zeros((n, 3)),
        np.zeros(n), np.ones(n), heading, frame.q_lab_from_flu.copy(), np.full(n, frame.t_capture_ns, dtype=np.int64),
    )  # fmt: skip


def estimate(
    state: EstimatorState, settings: EstimatorSettings, frame: MocapFrame, history: History, airborne: NDArray[np.bool_]
) -> EstimatorState:
    """The observers after one more frame of the same n bodies; a frame that is not newer changes nothing.

    airborne (n): where not, the thrust's strength is not learned (the floor carries part of the weight).
    """
    if frame.t_capture_ns <= state.t_ns:
        return state
    pos, vel, dist = state.pos_lab_m.copy(), state.vel_lab_m_s.copy(), state.dist_lab_m_s2.copy()
    force, lift, strength = state.force_lab_m_s2.copy(), state.lift_m_s2.copy(), state.strength.copy()
    heading, q, seen_ns = state.heading.copy(), state.q_lab_from_flu.copy(), state.seen_ns.copy()
    _observe(
        state.t_ns, frame.t_capture_ns, frame.pos_lab_m, frame.q_lab_from_flu, frame.seen, airborne,
        settings.horizontal, settings.vertical, settings.heading, settings.response, settings.own,
        settings.strength_lag_s, history.t_ns, history.force,
        pos, vel, dist, force, lift, strength, heading, q, seen_ns,
    )  # fmt: skip
    return EstimatorState(frame.t_capture_ns, pos, vel, dist, force, lift, strength, heading, q, seen_ns)


def swarm_state(state: EstimatorState) -> SwarmState:
    """The estimate as the message that is logged and shown."""
    acc = state.strength[:, None] * state.force_lab_m_s2 + state.dist_lab_m_s2
    acc[:, 2] -= np.where(state.lift_m_s2 > 0.0, GRAVITY_M_S2, 0.0)
    age_s = np.asarray((state.t_ns - state.seen_ns) * SECONDS, dtype=np.float64)
    return SwarmState(
        state.t_ns, state.pos_lab_m, state.vel_lab_m_s, state.dist_lab_m_s2, acc, state.q_lab_from_flu,
        state.heading[:, 0], state.heading[:, 1], state.heading[:, 2], age_s,
    )  # fmt: skip


@kernel
def fteso_step(
    z1: float, z2: float, z3: float, model: float, y: float, dt_s: float, w: float, alpha: float, scale: float
) -> tuple[float, float, float]:
    """Eqs. (3)-(4) over dt_s by an implicit step: the correction is evaluated at the error it leaves.

    model: g(x) u + f(x), m/s^2, mean over the step; y: the new measurement. Unconditionally stable, and free of the
    chatter an explicit step of sig(e) shows near e = 0. After Acary and Brogliato, implicit sliding-mode
    discretisation (2010).
    """
    z1 = z1 + dt_s * z2 + 0.5 * dt_s * dt_s * (z3 + model)
    z2 = z2 + dt_s * (z3 + model)
    k1, k2, k3 = 3.0 * w * dt_s, 3.0 * w * w * dt_s * dt_s, w * w * w * dt_s * dt_s * dt_s
    p1, p2, p3 = 1.0 + alpha, 1.0 + 2.0 * alpha, 1.0 + 3.0 * alpha
    left = implicit_root((y - z1) / scale, k1, p1, k2, p2, k3, p3, 0.0)
    third = k3 * sig(left, p3, 0.0)
    second = k2 * sig(left, p2, 0.0) + third
    return y - scale * left, z2 + scale * second / dt_s, z3 + scale * third / (dt_s * dt_s)


@kernel
def wrapped(angle: float) -> float:
    """The same angle in [-pi, pi)."""
    return (angle + np.pi) % (2.0 * np.pi) - np.pi


@kernel
def _observe_heading(i: int, q: Float, seen: bool, dt_s: float, gains: Float, heading: Float) -> None:
    """Advances heading[i] (angle, rate, acceleration) over dt_s; the angle is unwrapped."""
    psi, rate, acc = heading[i, 0], heading[i, 1], heading[i, 2]
    if seen:
        w, x, y, z = q[i, 0], q[i, 1], q[i, 2], q[i, 3]
        measured = np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
        ahead = psi + dt_s * rate + 0.5 * dt_s * dt_s * acc
        y_psi = ahead + wrapped(measured - ahead)
        psi, rate, acc = fteso_step(psi, rate, acc, 0.0, y_psi, dt_s, gains[i, 0], gains[i, 1], gains[i, 2])
    else:
        psi += dt_s * rate
        acc = 0.0
    heading[i, 0], heading[i, 1], heading[i, 2] = psi, rate, acc


@kernel
def _rebuild_force(
    i: int, from_ns: int, to_ns: int, q: Float, seen: bool, response: Float, sent_ns: NDArray[np.int64], sent: Float,
    force: Float, lift: Float,
) -> None:  # fmt: skip
    """force[i], lift[i] at to_ns: delivered thrust along the measured body z; unseen, along the modelled one.

    sent (h, 4): this vehicle's own history.
    """
    lift[i], _, _ = answer(sent_ns, sent[:, 3], from_ns, to_ns, response[i, 2], response[i, 3], lift[i])
    if seen:
        w, x, y, z = q[i, 0], q[i, 1], q[i, 2], q[i, 3]
        force[i, 0] = lift[i] * 2.0 * (x * z + w * y)
        force[i, 1] = lift[i] * 2.0 * (y * z - w * x)
        force[i, 2] = lift[i] * (1.0 - 2.0 * (x * x + y * y))
        return
    for axis in range(3):
        dead, lag = (response[i, 0], response[i, 1]) if axis < 2 else (response[i, 2], response[i, 3])
        force[i, axis], _, _ = answer(sent_ns, sent[:, axis], from_ns, to_ns, dead, lag, force[i, axis])


@kernel
def _observe(
    from_ns: int, to_ns: int, pos_measured: Float, q_measured: Float, seen: NDArray[np.bool_],
    airborne: NDArray[np.bool_], horizontal: Float, vertical: Float, yaw_gains: Float, response: Float,
    own: NDArray[np.int64], strength_lag_s: float, sent_ns: NDArray[np.int64], sent: Float,
    pos: Float, vel: Float, dist: Float, force: Float, lift: Float, strength: Float, heading: Float, q: Float,
    seen_ns: NDArray[np.int64],
) -> None:  # fmt: skip
    """One frame for all n vehicles, in place; see `estimate`."""
    dt_s = (to_ns - from_ns) * SECONDS
    before = np.zeros(3)
    for i in range(len(own)):
        if seen[i]:
            q[i] = q_measured[i]
            seen_ns[i] = to_ns
        gravity = 0.0
        before[:] = force[i]
        if own[i] >= 0:
            gravity = GRAVITY_M_S2
            mine = sent[:, own[i]]
            _rebuild_force(i, from_ns, to_ns, q, seen[i], response, sent_ns, mine, force, lift)
        for axis in range(3):
            model = strength[i] * 0.5 * (before[axis] + force[i, axis])
            if axis == 2:
                model -= gravity
            gains = vertical[i] if axis == 2 else horizontal[i]
            if seen[i]:
                z1, z2, z3 = fteso_step(
                    pos[i, axis], vel[i, axis], dist[i, axis], model, pos_measured[i, axis], dt_s,
                    gains[0], gains[1], gains[2],
                )  # fmt: skip
            else:
                z3 = dist[i, axis]
                z1 = pos[i, axis] + dt_s * vel[i, axis] + 0.5 * dt_s * dt_s * (model + z3)
                z2 = vel[i, axis] + dt_s * (model + z3)
            pos[i, axis], vel[i, axis] = z1, z2
            dist[i, axis] = min(max(z3, -DIST_MAX_M_S2), DIST_MAX_M_S2)
        if airborne[i] and own[i] >= 0 and seen[i] and force[i, 2] > 0.3 * GRAVITY_M_S2:
            _learn_strength(i, dt_s, strength_lag_s, force, strength, dist)
        _observe_heading(i, q, seen[i], dt_s, yaw_gains, heading)


@kernel
def _learn_strength(i: int, dt_s: float, lag_s: float, force: Float, strength: Float, dist: Float) -> None:
    """Moves what Z3 holds against gravity slowly into the thrust's strength; the sum of both stays as it is."""
    share = dt_s / (lag_s + dt_s)
    learned = strength[i] + share * dist[i, 2] / force[i, 2]
    learned = min(max(learned, STRENGTH_LOW), STRENGTH_HIGH)
    moved = learned - strength[i]
    strength[i] = learned
    dist[i, 2] -= moved * force[i, 2]
    # Level flight keeps its horizontal sum too: a steady tilt against the wind is re-explained, not forgotten.
    dist[i, 0] -= moved * force[i, 0]
    dist[i, 1] -= moved * force[i, 1]

"""The observers after one more frame: position, velocity and disturbance of every vehicle, and its heading.

One finite-time extended state observer (FTESO, Eqs. 3-4) per axis, stepped implicitly so that it is stable at any
frame rate; where the preset says so, two along the horizontal axes of a vehicle we command, a slow and a fast one
(formation.estimation.observers). It is fed the acceleration rebuilt from the measured attitude and the thrust delivered
so far; fed the commanded acceleration instead, Z3 would fight the vehicle's own lag.
"""

from math import sqrt

import numpy as np
from numpy.typing import NDArray

from formation.estimation.downwash import downwash_m_s2, follow_downwash, jets
from formation.estimation.heading import AMPLIFIED, observe_heading
from formation.estimation.observers import (
    PUSH_MOST_M_S2,
    adapt,
    height_gain,
    learn_noise,
    observe_parallel,
    receive_inertial,
)
from formation.estimation.response import (
    NEVER_NS,
    SECONDS,
    SentCommands,
    answer,
    attitude_dead_s,
    learn_thrust_scale,
    observe_tilt,
    update_model_mismatch,
)
from formation.estimation.settings import ObserverSettings
from formation.estimation.state import VehicleEstimate
from formation.maths import frames
from formation.maths.arrays import Flags, Float, Scalars, Vec3s
from formation.maths.kernel import kernel
from formation.maths.quaternion import thrust_axis
from formation.maths.records import Rows, blank, like
from formation.messages import LabFrame, SwarmState
from formation.paper.eq34_observer import fteso_step
from formation.vehicle.body import GRAVITY_M_S2

NOISE_FIRST_M, NOISE_FIRST_RAD, ACCEL_NOISE_INITIAL_M_S2 = 2e-4, 3e-3, 0.3  # the first guess of each sensor's noise
LIFT_LEAST = 0.3  # of gravity: below it the thrust scale is not learned


def initial(frame: LabFrame, flying: Flags) -> Rows[VehicleEstimate]:
    """All n at rest where the first frame sees them; flying (n): commanded ones that hover there already.

    A body that the frame does not see is nowhere yet: it begins with the first frame that does.
    """
    z = blank(VehicleEstimate, len(frame.bodies))
    z["t_ns"] = frame.t_capture_ns
    seen = z["seen"]
    seen["t_ns"] = np.where(frame.seen, frame.t_capture_ns, NEVER_NS)
    z["pos_lab_m"] = seen["pos_lab_m"] = frame.pos_lab_m
    z["q_lab_from_flu"] = frame.q_lab_from_flu
    z["heading"]["yaw_rad"] = frames.yaw(frame.q_lab_from_flu)
    z["thrust_m_s2"] = z["specific_force_lab_m_s2"][:, 2] = np.where(flying, GRAVITY_M_S2, 0.0)
    z["inertial"]["var_m2_s4"] = ACCEL_NOISE_INITIAL_M_S2**2
    noise = z["noise"]
    noise["var_m2"] = NOISE_FIRST_M**2
    noise["recent_ns"], noise["recent_m"] = NEVER_NS, frame.pos_lab_m[:, None, :]
    bank = z["heading_bank"]
    bank["observed"][:, :, 0] = bank["foretold_rad"] = z["heading"]["yaw_rad"][:, None]
    bank["measured_rad"], bank["noise_rad2"] = z["heading"]["yaw_rad"], NOISE_FIRST_RAD**2
    bank["square_rad2"] = (NOISE_FIRST_RAD * AMPLIFIED) ** 2
    z["thrust_scale"] = z["adaptive_gain"] = 1.0
    return z


def estimate(
    state: Rows[VehicleEstimate], settings: Rows[ObserverSettings], frame: LabFrame, history: Rows[SentCommands],
    airborne: Flags, yaw_acc_command_rad_s2: Scalars, force_meas_flu_m_s2: Vec3s,
) -> Rows[VehicleEstimate]:  # fmt: skip
    """The observers after one more frame of the same n bodies; one that is not newer brings but what was asked since.

    airborne (n): where not, the thrust scale is not learned (the floor carries part of the weight).
    yaw_acc_command_rad_s2 (n): angular acceleration of the heading that was asked for; zero where nobody asks.
    force_meas_flu_m_s2 (n, 3): specific force by the vehicle's accelerometer, mean since the last frame; NaN: not
    measured.
    """
    new = like(state)
    seen_ns = state["seen"]["t_ns"]
    if frame.t_capture_ns > state["t_ns"][0] and NEVER_NS in seen_ns.tolist():
        state = _begun(state, frame, (seen_ns == NEVER_NS) & frame.seen)
    _estimate(
        settings, frame.t_capture_ns, frame.pos_lab_m, frame.q_lab_from_flu, frame.seen, airborne,
        yaw_acc_command_rad_s2, force_meas_flu_m_s2, history, state, new,
    )  # fmt: skip
    return new


def _begun(state: Rows[VehicleEstimate], frame: LabFrame, appearing: Flags) -> Rows[VehicleEstimate]:
    """The estimate with the bodies `appearing` (n) at rest where this frame, the first to see them, has them."""
    fresh, begun = initial(frame, state["thrust_m_s2"] > 0.0), like(state)
    for i, appears in enumerate(appearing):
        begun[i] = fresh[i] if appears else state[i]
        begun[i].t_ns = state[i].t_ns
    return begun


@kernel
def _estimate(
    settings: Rows[ObserverSettings], to_ns: int, pos_lab_m: Float, q_lab_from_flu: Float, seen: NDArray[np.bool_],
    airborne: NDArray[np.bool_], yaw_acc_command_rad_s2: Float, force_meas_flu_m_s2: Float, history: Rows[SentCommands],
    old: Rows[VehicleEstimate], new: Rows[VehicleEstimate],
) -> None:  # fmt: skip
    """See `estimate`; new (n) is filled."""
    model, q_before, flying = np.zeros(3), np.zeros(4), jets(old, settings)
    for i in range(len(old)):
        new[i] = old[i]
        z, s = new[i], settings[i]
        z.heading.acc_command_rad_s2 = yaw_acc_command_rad_s2[i]
        from_ns = z.t_ns
        if to_ns > from_ns:
            dt_s = (to_ns - from_ns) * SECONDS
            z.t_ns = to_ns
            if seen[i]:
                z.seen.t_ns = to_ns
                for k in range(4):
                    q_before[k] = z.q_lab_from_flu[k]
                    z.q_lab_from_flu[k] = q_lab_from_flu[i, k]
            if s.commanded_index >= 0:
                follow_downwash(z, downwash_m_s2(flying, settings, i, dt_s) if airborne[i] else 0.0)
            model_acceleration(z, from_ns, to_ns, seen[i], airborne[i], s, history, model)
            if seen[i] and airborne[i] and s.parallel.bandwidth_rad_s > 0.0:
                receive_inertial(z, q_before, force_meas_flu_m_s2[i], dt_s, s.drag_1_s)
            observe(z, pos_lab_m[i], seen[i], airborne[i], model, dt_s, s)
            if seen[i]:
                for axis in range(3):
                    z.seen.pos_lab_m[axis], z.seen.vel_lab_m_s[axis] = z.pos_lab_m[axis], z.vel_lab_m_s[axis]
        _join_motion(z, s)


@kernel
def model_acceleration(
    z: VehicleEstimate, from_ns: int, to_ns: int, seen: bool, airborne: bool, s: ObserverSettings,
    history: Rows[SentCommands], model: Float,
) -> None:  # fmt: skip
    """g(x) u + f(x) of Eq. (4), mean over the step, into model (3): the scaled specific force, drag and gravity."""
    commanded = s.commanded_index >= 0
    dt_s = (to_ns - from_ns) * SECONDS
    for axis in range(3):
        model[axis] = 0.5 * z.specific_force_lab_m_s2[axis]
    if commanded:
        rebuild_force(z, from_ns, to_ns, seen, s, history[s.commanded_index])
        if airborne:
            update_model_mismatch(z, from_ns, to_ns, seen, s, history[s.commanded_index])
    elif s.tilt_bandwidth_rad_s > 0.0:
        observe_tilt(z, seen, dt_s, s)
    for axis in range(3):
        model[axis] = z.thrust_scale * (model[axis] + 0.5 * z.specific_force_lab_m_s2[axis])
    for axis in range(3):
        model[axis] -= s.drag_1_s[axis] * z.vel_lab_m_s[axis]
    if commanded:
        model[2] -= GRAVITY_M_S2
        if not airborne:  # the floor carries what the thrust does not
            model[2] = max(model[2], 0.0)


@kernel
def rebuild_force(
    z: VehicleEstimate, from_ns: int, to_ns: int, seen: bool, s: ObserverSettings, sent: SentCommands
) -> None:
    """Specific force and thrust at to_ns: delivered thrust along the body's z, modelled, then set right as seen."""
    upward, speed, travel = np.empty(2), np.empty(2), np.empty(2)
    force, response = z.specific_force_lab_m_s2, s.response
    upward[0], upward[1] = force[2], z.thrust_m_s2
    answer(sent.t_ns, sent.force[:, 0:2], from_ns, to_ns, attitude_dead_s(z, s), response.attitude_lag_s,
           force[0:2], speed, travel)  # fmt: skip
    answer(sent.t_ns, sent.force[:, 2:4], from_ns, to_ns, response.thrust_dead_s, response.thrust_lag_s,
           upward, speed, travel)  # fmt: skip
    force[2], z.thrust_m_s2 = upward[0], upward[1]
    if not seen:
        return
    along = thrust_axis(z.q_lab_from_flu)
    trust = s.attitude_trust + z.fast.weight * (s.parallel.attitude_trust - s.attitude_trust)
    for axis in range(2):
        force[axis] += trust * (z.thrust_m_s2 * along[axis] - z.model_error.level_bias_m_s2[axis] - force[axis])
    force[2] = z.thrust_m_s2 * along[2]


@kernel
def observe(
    z: VehicleEstimate, pos_lab_m: Float, seen: bool, airborne: bool, model: Float, dt_s: float, s: ObserverSettings
) -> None:
    """All observers of one vehicle over one step; pos_lab_m (3): as measured; model (3): `model_acceleration`."""
    commanded = s.commanded_index >= 0
    if seen:
        learn_noise(z, z.t_ns, pos_lab_m)
        if not commanded:
            adapt(z, pos_lab_m, model, dt_s, s)
    alone = 0
    if seen and s.parallel.bandwidth_rad_s > 0.0:
        observe_parallel(z, pos_lab_m, model, dt_s, noise_bandwidth_factor(z, s), s.horizontal, s.parallel)
        alone = 2
    for axis in range(alone, 3):
        observe_axis(z, axis, pos_lab_m[axis], seen, model[axis], dt_s, s)
    for axis in range(3):
        z.dist_lab_m_s2[axis] = min(max(z.dist_lab_m_s2[axis], -PUSH_MOST_M_S2), PUSH_MOST_M_S2)
    if airborne and commanded and seen and z.specific_force_lab_m_s2[2] > LIFT_LEAST * GRAVITY_M_S2:
        learn_thrust_scale(z, dt_s, s)
    observe_heading(z, seen, dt_s, s)


@kernel
def noise_bandwidth_factor(z: VehicleEstimate, s: ObserverSettings) -> float:
    """Factor on bandwidths in more noise than they were made for: the cube root of how much more.

    A Kalman filter of a position whose acceleration walks at random has w = (density of walk / of noise)^(1/6).
    """
    factor: float = min(s.quiet_m / sqrt(z.noise.var_m2), 1.0) ** (1.0 / 3.0)
    return factor


@kernel
def observe_axis(
    z: VehicleEstimate, axis: int, measured: float, seen: bool, model: float, dt_s: float, s: ObserverSettings
) -> None:
    """One axis's FTESO, slower in noise and, of a vehicle that is only observed, faster by the adaptive gain.

    Unseen, the model alone.
    """
    z1, z2, z3 = z.pos_lab_m[axis], z.vel_lab_m_s[axis], z.dist_lab_m_s2[axis]
    gains = s.horizontal if axis < 2 else s.vertical
    if seen:
        w = gains.bandwidth_rad_s * noise_bandwidth_factor(z, s)
        if s.commanded_index < 0:
            w *= z.adaptive_gain
        elif axis == 2:
            w *= height_gain(z, measured, model, dt_s)
        z1, z2, z3 = fteso_step(z1, z2, z3, model, measured, dt_s, w, gains.alpha, gains.scale, gains.smooth)
    else:
        z1 += dt_s * z2 + 0.5 * dt_s * dt_s * (model + z3)
        z2 += dt_s * (model + z3)
    z.pos_lab_m[axis], z.vel_lab_m_s[axis], z.dist_lab_m_s2[axis] = z1, z2, z3


@kernel
def _join_motion(z: VehicleEstimate, s: ObserverSettings) -> None:
    """Position, velocity and acceleration of x, y, z and heading as one motion."""
    commanded, heading = s.commanded_index >= 0, z.heading
    for axis in range(3):
        z.motion[0, axis], z.motion[1, axis] = z.pos_lab_m[axis], z.vel_lab_m_s[axis]
        forced = z.thrust_scale * z.specific_force_lab_m_s2[axis] - s.drag_1_s[axis] * z.vel_lab_m_s[axis]
        z.motion[2, axis] = forced + z.dist_lab_m_s2[axis]
    if commanded:
        z.motion[2, 2] -= GRAVITY_M_S2
    z.motion[0, 3], z.motion[1, 3] = heading.yaw_rad, heading.rate_rad_s
    z.motion[2, 3] = heading.dist_rad_s2 + heading.acc_command_rad_s2


def swarm_state(z: Rows[VehicleEstimate]) -> SwarmState:
    """The estimate as the message that is logged and shown."""
    motion, heading, t_ns = z["motion"], z["heading"], int(z["t_ns"][0])
    age_s = [(t_ns - seen_ns) * SECONDS if seen_ns > NEVER_NS else np.inf for seen_ns in z["seen"]["t_ns"].tolist()]
    return SwarmState(
        t_ns,
        pos_lab_m=z["pos_lab_m"],
        vel_lab_m_s=z["vel_lab_m_s"],
        dist_lab_m_s2=z["dist_lab_m_s2"],
        acc_lab_m_s2=motion[:, 2, :3],
        q_lab_from_flu=z["q_lab_from_flu"],
        yaw_rad=heading["yaw_rad"],
        yaw_rate_rad_s=heading["rate_rad_s"],
        yaw_acc_rad_s2=motion[:, 2, 3],
        age_s=np.array(age_s),
        model_mismatch=z["model_error"]["mismatch"],
    )

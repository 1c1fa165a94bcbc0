"""What the observers remember of every vehicle."""

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from formation.maths import frames
from formation.maths.arrays import Flags, Float, Layout, Mat3, Motion, Quat, Vec2, Vec3
from formation.maths.records import Rows, blank
from formation.messages import LabFrame, SwarmState
from formation.vehicle.body import GRAVITY_M_S2
from formation.vehicle.response import NEVER_NS, SECONDS

NOISE_FIRST_M, FELT_NOISE_FIRST_M_S2 = 2e-4, 0.3  # of a position, of an accelerometer: the first guess


@dataclass(slots=True)
class VehicleEstimate:
    """What is known of one vehicle at capture time t_ns; a record (formation.maths.records).

    Z1, Z2, Z3 of the FTESO are pos, vel and dist, and yaw, yaw_rate and yaw_dist of the heading (unwrapped).
    motion: position, velocity and acceleration of x, y, z, heading in `lab`, accelerations with Z3 in them.
    seen_ns: capture time of the last frame that saw it; seen_pos, seen_vel: Z1 and Z2 then; yaw_acc_command_rad_s2:
    what was asked of its heading.

    specific_force: modelled, at t_ns, before thrust_scale; thrust_m_s2: its length, the thrust delivered;
    thrust_scale: true thrust per modelled thrust (mass, battery, propellers).
    tilt, tilt_rate_1_s: of a vehicle that is only observed, horizontal over vertical force, x and y;
    force_rate: how fast its specific force turns.

    innovation: filtered, of a vehicle that is only observed, of the height alone of one that is commanded;
    noise_var_m2: learned variance of the measured position; recent_m, recent_ns: the last three positions seen;
    adaptive_gain: formation.estimation.adaptive_gain, and of a commanded vehicle its urgency,
    formation.estimation.parallel; gate, spread: how far the estimate has gone over to the fast observer, and what that
    one has more of position, velocity and disturbance (rows) along x and y than the slow one; yaw_*: the same of the
    heading.
    inertial_*: formation.estimation.inertial.
    nominal_force_m_s2: horizontal force if the vehicle answered as its profile says; level_bias_m_s2: what the measured
    force lastingly misses of it; mismatch_moments, model_mismatch; slow_rate, slow_miss, shift_moments,
    delay_shift_s: formation.estimation.model_mismatch.
    """

    t_ns: int
    seen_ns: int
    seen_pos_lab_m: Vec3
    seen_vel_lab_m_s: Vec3
    pos_lab_m: Vec3
    vel_lab_m_s: Vec3
    dist_lab_m_s2: Vec3
    q_lab_from_flu: Quat
    yaw_rad: float
    yaw_rate_rad_s: float
    yaw_dist_rad_s2: float
    yaw_acc_command_rad_s2: float
    motion: Motion
    specific_force_lab_m_s2: Vec3
    thrust_m_s2: float
    thrust_scale: float
    tilt: Vec2
    tilt_rate_1_s: Vec2
    force_rate_lab_m_s3: Vec3
    innovation_m: Vec3
    noise_var_m2: float
    recent_m: Mat3
    recent_ns: Annotated[Float, Layout(np.int64, (3,))]
    adaptive_gain: float
    gate: float
    spread: Mat3
    yaw_ratio: float
    yaw_spread: Vec3
    inertial_ratio: float
    inertial_bias_m_s2: Vec2
    inertial_var_m2_s4: float
    nominal_force_m_s2: Vec2
    level_bias_m_s2: Vec2
    mismatch_moments: Vec3
    model_mismatch: float
    slow_rate_m_s3: Vec2
    slow_miss_m_s2: Vec2
    shift_moments: Vec2
    delay_shift_s: float


def initial(frame: LabFrame, flying: Flags) -> Rows[VehicleEstimate]:
    """All n at rest where the first frame sees them; flying (n): commanded ones that hover there already.

    A body that the frame does not see is nowhere yet: it begins with the first frame that does.
    """
    z = blank(VehicleEstimate, len(frame.bodies))
    z["t_ns"] = frame.t_capture_ns
    z["seen_ns"] = np.where(frame.seen, frame.t_capture_ns, NEVER_NS)
    z["pos_lab_m"] = z["seen_pos_lab_m"] = frame.pos_lab_m
    z["q_lab_from_flu"] = frame.q_lab_from_flu
    z["yaw_rad"] = frames.yaw(frame.q_lab_from_flu)
    z["thrust_m_s2"] = z["specific_force_lab_m_s2"][:, 2] = np.where(flying, GRAVITY_M_S2, 0.0)
    z["noise_var_m2"] = NOISE_FIRST_M**2
    z["inertial_var_m2_s4"] = FELT_NOISE_FIRST_M_S2**2
    z["recent_m"] = frame.pos_lab_m[:, None, :]
    z["recent_ns"] = NEVER_NS
    for name in ("thrust_scale", "adaptive_gain"):
        z[name] = 1.0
    return z


def swarm_state(z: Rows[VehicleEstimate]) -> SwarmState:
    """The estimate as the message that is logged and shown."""
    motion, t_ns = z["motion"], int(z["t_ns"][0])
    age_s = [(t_ns - seen_ns) * SECONDS if seen_ns > NEVER_NS else np.inf for seen_ns in z["seen_ns"].tolist()]
    return SwarmState(
        t_ns, z["pos_lab_m"], z["vel_lab_m_s"], z["dist_lab_m_s2"], motion[:, 2, :3], z["q_lab_from_flu"],
        z["yaw_rad"], z["yaw_rate_rad_s"], motion[:, 2, 3],
        np.array(age_s), z["model_mismatch"],
    )  # fmt: skip

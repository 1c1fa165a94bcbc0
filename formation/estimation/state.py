"""What the observers remember of every vehicle: a record, without code."""

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from formation.maths.arrays import Float, Layout, Mat3, Motion, Quat, Vec2, Vec3


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
    noise_var_m2, yaw_noise_var_rad2: learned variances of the measured position and heading; recent_m, recent_yaw_rad,
    recent_ns: the last three seen;
    adaptive_gain, and of a commanded vehicle its urgency; fast_weight: blending weight of the fast observer;
    fast_minus_slow: its position, velocity and disturbance (rows) along x and y, less the slow observer's; push_sign:
    the side to which they were apart last, fading; reversals: how often that changed of late; yaw_*: the same of the
    heading; inertial_*: of the accelerometer (all of formation.estimation.observers).
    nominal_force_m_s2: horizontal force if the vehicle answered as its profile says; level_bias_m_s2: what the measured
    force lastingly misses of it; mismatch_moments, model_mismatch; slow_rate, slow_miss, shift_moments,
    delay_shift_s: formation.estimation.response.
    """

    t_ns: int
    seen_ns: int
    seen_pos_lab_m: Vec3
    seen_vel_lab_m_s: Vec3
    pos_lab_m: Vec3
    vel_lab_m_s: Vec3
    dist_lab_m_s2: Vec3
    dist_late_lab_m_s2: Vec2
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
    yaw_noise_var_rad2: float
    recent_m: Mat3
    recent_yaw_rad: Vec3
    recent_ns: Annotated[Float, Layout(np.int64, (3,))]
    adaptive_gain: float
    fast_weight: float
    fast_minus_slow: Mat3
    push_sign: Vec2
    reversals: Vec2
    yaw_ratio: float
    yaw_fast_minus_slow: Vec3
    inertial_ratio: float
    inertial_bias_m_s2: Vec2
    inertial_var_m2_s4: float
    nominal_force_m_s2: Vec2
    level_bias_m_s2: Vec2
    mismatch_moments: Vec3
    model_mismatch: float
    slow_rate_m_s3: Vec2
    slow_innovation_m_s2: Vec2
    shift_moments: Vec2
    delay_shift_s: float

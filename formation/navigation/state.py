"""What the navigator knows of one body, and the order of its error state.

    error = (position, velocity, attitude, accelerometer bias, level bias, thrust scale, pose delay, stamp)

The stamp's is that of the newest pose alone: what scatters, as the delay is what stays.
Attitude errors turn in `lab`: R_true = exp(error) R. Biases are in `flu`. All errors are true minus estimated.
"""

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from formation.maths.arrays import Float, Layout, Quat, Vec3, Vec4

POS, VEL, ATT, BIAS, LEVEL = range(0, 15, 3)
SCALE, DELAY, STAMP, ERRORS = range(15, 19)
POSE_POSITION, POSE_ATTITUDE, AUTOPILOT_ATTITUDE, THRUST, SOURCES = range(5)
"""Where each source's innovation is; for position and attitude of a pose, autopilot's attitude and thrust."""
SAMPLES = 1024
"""Inertial samples kept: 5 s at PX4's 200 Hz, more than the oldest onset."""
THRUSTS = 64
"""Commanded thrusts kept: more than the dead time of any profile at 250 Hz."""
PENDING = 16
"""Poses that wait for the inertial samples of their time: 0.13 s at 120 Hz."""

Covariance = Annotated[Float, Layout(np.float64, (ERRORS, ERRORS))]
Error = Annotated[Float, Layout(np.float64, (ERRORS,))]
SourceVectors = Annotated[Float, Layout(np.float64, (SOURCES, 3))]
SampleTimes = Annotated[Float, Layout(np.int64, (SAMPLES,))]
SampleVectors = Annotated[Float, Layout(np.float64, (SAMPLES, 3))]


@dataclass(slots=True)
class Estimate:
    """The state of one body at t_ns; a record (formation.maths.records).

    accel_bias_flu_m_s2: what the accelerometer shows too much. level_bias_flu_rad: rotation from the mocap's attitude
    of the body to the autopilot's. thrust_scale: true thrust per modelled thrust. pose_delay_s: age of a pose at its
    stamp. thrust_m_s2: modelled specific force along body z, NaN where unknown. rate_flu_rad_s, force_lab_m_s2: the
    newest, bias taken out. cov: of the error state.
    """

    t_ns: int
    pos_lab_m: Vec3
    vel_lab_m_s: Vec3
    q_lab_from_flu: Quat
    accel_bias_flu_m_s2: Vec3
    level_bias_flu_rad: Vec3
    thrust_scale: float
    pose_delay_s: float
    thrust_m_s2: float
    rate_flu_rad_s: Vec3
    force_lab_m_s2: Vec3
    cov: Covariance


@dataclass(slots=True)
class Noise:
    """Learned variances: of each source's observation, of one inertial sample along each body axis.

    source: in m^2, rad^2, rad^2 and m^2/s^4. last_*: the sample before.
    """

    source: Vec4
    force_m2_s4: Vec3
    rate_rad2_s2: Vec3
    last_ns: int
    last_force_flu_m_s2: Vec3
    last_rate_flu_rad_s: Vec3


@dataclass(slots=True)
class Inertial:
    """A ring of inertial samples of one body, each the mean until t_ns; count: received so far.

    force NaN: there is no accelerometer, the force is modelled by thrust and drag.
    """

    count: int
    t_ns: SampleTimes
    force_flu_m_s2: SampleVectors
    rate_flu_rad_s: SampleVectors


@dataclass(slots=True)
class Commanded:
    """A ring of thrusts commanded from t_ns on, as specific force, m/s^2; NaN: nobody knows."""

    count: int
    t_ns: Annotated[Float, Layout(np.int64, (THRUSTS,))]
    thrust_m_s2: Annotated[Float, Layout(np.float64, (THRUSTS,))]


@dataclass(slots=True)
class Pending:
    """Poses not yet used, oldest first; last_*: the last that was received, as it came.

    attitude_t_ns, q_lab_from_flu_autopilot: the autopilot's attitude that waits for inertial samples; 0: none does.
    """

    count: int
    t_ns: Annotated[Float, Layout(np.int64, (PENDING,))]
    pos_lab_m: Annotated[Float, Layout(np.float64, (PENDING, 3))]
    q_lab_from_flu: Annotated[Float, Layout(np.float64, (PENDING, 4))]
    last_pos_lab_m: Vec3
    last_q_lab_from_flu: Quat
    attitude_t_ns: int
    q_lab_from_flu_autopilot: Quat


@dataclass(slots=True)
class Status:
    """How one body's poses stand.

    begun: a pose was received. timed: the pose delay is accounted for. rejecting_ns: since when poses are rejected, 0:
    they are not. consistent_ns: since when they have been consistent again, 0: they are not. gap: inertial samples were
    missing since the last pose.
    """

    begun: bool
    timed: bool
    rejecting_ns: int
    consistent_ns: int
    gap: bool


@dataclass(slots=True)
class Airframe:
    """What is known of one vehicle, to model its force: linear drag over mass, and how its thrust follows commands."""

    drag_flu_1_s: Vec3
    thrust_dead_time_ns: int
    thrust_lag_s: float


@dataclass(slots=True)
class Innovations:
    """The newest normalised innovation of every source (rows), as PX4's EstimatorAidSource3d.

    test_ratio: squared innovation over (limit squared times innovation variance); above 1 it is inconsistent.
    Unobserved axes are zero.
    """

    t_ns: Annotated[Float, Layout(np.int64, (SOURCES,))]
    observation: SourceVectors
    innovation: SourceVectors
    innovation_variance: SourceVectors
    test_ratio: SourceVectors
    rejected: Annotated[Float, Layout(np.int64, (SOURCES,))]
    fused: Annotated[Float, Layout(np.int64, (SOURCES,))]


@dataclass(slots=True)
class Fault:
    """The newest detected fault. row: of the signature table, -1: none; onset_ns: stamp of the last consistent pose.

    statistic: twice the log-likelihood ratio. amplitude: along x, y, z of `lab`, or the first alone, in the row's unit.
    """

    row: int
    t_ns: int
    onset_ns: int
    statistic: float
    amplitude: Vec3


@dataclass(slots=True)
class Body:
    """All that the navigator keeps of one body."""

    estimate: Estimate
    noise: Noise
    inertial: Inertial
    commanded: Commanded
    pending: Pending
    status: Status
    airframe: Airframe
    innovations: Innovations
    fault: Fault

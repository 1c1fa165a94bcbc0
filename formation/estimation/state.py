"""What the observers estimate and remember of every vehicle: records, without code.

Each record in `VehicleEstimate` is what one mechanism remembers from frame to frame.
"""

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from formation.maths.arrays import Float, Layout, Mat3, Motion, Quat, Vec2, Vec3, Vec4


@dataclass(slots=True)
class LastSeen:
    """Capture time of the last frame that saw the vehicle (NEVER_NS: none yet), and Z1 and Z2 then."""

    t_ns: int
    pos_lab_m: Vec3
    vel_lab_m_s: Vec3


@dataclass(slots=True)
class HeadingEstimate:
    """Z1, Z2 and Z3 of the heading's observers, the angle unwrapped, and the turn that was asked for."""

    yaw_rad: float
    rate_rad_s: float
    dist_rad_s2: float
    acc_command_rad_s2: float


@dataclass(slots=True)
class HeadingBank:
    """The observers of a heading that is only observed, and how well each has foretold it (`heading.observe_bank`).

    observed: angle, rate and acceleration (columns) of every observer. foretold: what each one predicts, low-passed;
    earlier: the same at earlier_ns (0: nothing), until it is judged; measured: the angle of the last frame, low-passed.
    square: of every observer, the mean square of its low-passed error; noise: of what the fastest one did not expect.
    """

    observed: Annotated[Float, Layout(np.float64, (4, 3))]
    foretold_rad: Vec4
    earlier_ns: Annotated[Float, Layout(np.int64, (8,))]
    earlier_rad: Annotated[Float, Layout(np.float64, (8, 4))]
    measured_rad: float
    square_rad2: Vec4
    noise_rad2: float


@dataclass(slots=True)
class ObservedTilt:
    """Of a vehicle that is only observed: how its specific force turns (`response.observe_tilt`).

    tilt, tilt_rate_1_s: horizontal over vertical force, x and y; force_rate: rate of the specific force.
    """

    tilt: Vec2
    tilt_rate_1_s: Vec2
    force_rate_lab_m_s3: Vec3


@dataclass(slots=True)
class NoiseEstimate:
    """Learned variance of the measured position, and the last three that were seen (`learn_noise`)."""

    var_m2: float
    recent_ns: Annotated[Float, Layout(np.int64, (3,))]
    recent_m: Mat3


@dataclass(slots=True)
class FastObserver:
    """The fast observer along x and y, beside the slow one (`observers.observe_parallel`).

    weight: of the fast one in the estimate; minus_slow: its position, velocity and disturbance (rows) along x and y,
    less the slow one's; push_sign: the side to which they were apart last, fading; reversals: how often that changed
    of late.
    """

    weight: float
    minus_slow: Mat3
    push_sign: Vec2
    reversals: Vec2


@dataclass(slots=True)
class InertialInnovation:
    """The accelerometer's innovation across the thrust (`observers.receive_inertial`).

    ratio: the largest of late of its square over that of its noise limit; bias, var: its lasting part, its variance.
    """

    ratio: float
    bias_m_s2: Vec2
    var_m2_s4: float


@dataclass(slots=True)
class ModelError:
    """How a commanded vehicle answers otherwise than its profile says (`response.update_model_mismatch`).

    nominal_force: horizontal force if it answered as its profile says. Measured less that is the innovation, of which
    level_bias is the lasting part. moments: means of rate^2, innovation^2 and their product; they give the mismatch.
    slow_rate, slow_innovation: both behind a filter of the response's length; shift_moments: means of slow rate^2 and
    the product; they give delay_shift_s, by which its answer is early.
    """

    nominal_force_m_s2: Vec2
    level_bias_m_s2: Vec2
    moments: Vec3
    mismatch: float
    slow_rate_m_s3: Vec2
    slow_innovation_m_s2: Vec2
    shift_moments: Vec2
    delay_shift_s: float


@dataclass(slots=True)
class VehicleEstimate:
    """What is known of one vehicle at capture time t_ns; a record (formation.maths.records).

    Estimated: pos, vel and dist, which are Z1, Z2 and Z3 of the FTESO; the heading; and `motion`, made of these:
    position, velocity and acceleration of x, y, z, heading in `lab`, accelerations with Z3 in them.
    Modelled: specific_force at t_ns, before thrust_scale; thrust_m_s2: its length, the thrust delivered; thrust_scale:
    true thrust per modelled thrust (mass, battery, propellers).
    Remembered, to make it: the attitude and the time last seen; `noise` of the cameras; how fast the observers are:
    the filtered innovation of a vehicle that is only observed (of one that is commanded, of its height alone),
    adaptive_gain (of a commanded vehicle its urgency), the `fast` observer and the `inertial` innovation; what
    sets the modelled force right: `observed` of a vehicle that is only observed, `model_error` of a commanded one;
    downwash: what Z3 of the height has of it.
    """

    t_ns: int
    pos_lab_m: Vec3
    vel_lab_m_s: Vec3
    dist_lab_m_s2: Vec3
    heading: HeadingEstimate
    heading_bank: HeadingBank
    motion: Motion
    specific_force_lab_m_s2: Vec3
    thrust_m_s2: float
    thrust_scale: float
    q_lab_from_flu: Quat
    seen: LastSeen
    noise: NoiseEstimate
    innovation_m: Vec3
    adaptive_gain: float
    fast: FastObserver
    inertial: InertialInnovation
    observed: ObservedTilt
    model_error: ModelError
    downwash_m_s2: float

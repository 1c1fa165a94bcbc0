"""Whether a vehicle answers its commands as its profile says: a shift in time, a lasting lean, or plainly otherwise."""

from math import exp, sqrt

import numpy as np

from formation.estimation.settings import ObserverSettings
from formation.estimation.state import VehicleEstimate
from formation.maths.kernel import kernel
from formation.maths.quaternion import thrust_axis
from formation.vehicle.response import SECONDS, SentCommands, answer

LAG_S, RATE_M_S3 = 2.0, 3.0  # over how long it is judged; turns as slow as this say little
MISMATCH_TOLD, MISMATCH_FAIR, MISMATCH_BAD = 0.38, 0.45, 0.55
SHIFT_LAG_S, SHIFT_RATE_M_S3 = 4.0, 0.25  # the same of the shift
BIAS_LAG_S, BIAS_MAX_M_S2 = 0.5, 1.0


@kernel
def judge_answer(
    z: VehicleEstimate, from_ns: int, to_ns: int, seen: bool, settings: ObserverSettings, sent: SentCommands
) -> None:
    """How much earlier, and how far otherwise, a vehicle answers than its profile says: delay shift and mismatch.

    What the nominal response alone makes of the commands is held against the force measured. The part of the miss that
    goes with the nominal rate of change is a shift in time (`learn_shift`); the rest over that rate and the response's
    length is the mismatch. Noise and a plainly slower vehicle show little; one that swings because its motors cannot
    follow shows 0.4 and more, and no shift; one that is as believed 0.36 at most.
    """
    speed, travel = np.empty(2), np.empty(2)
    before_x, before_y = z.nominal_force_m_s2[0], z.nominal_force_m_s2[1]
    dead_s, lag_s = settings.nominal_dead_s, settings.nominal_lag_s
    answer(sent.t_ns, sent.force[:, 0:2], from_ns, to_ns, dead_s, lag_s, z.nominal_force_m_s2, speed, travel)
    if not seen:
        return
    along = thrust_axis(z.q_lab_from_flu)
    dt_s = (to_ns - from_ns) * SECONDS
    length_s = dead_s + lag_s
    slow = 1.0 - exp(-dt_s / length_s)
    rate2, miss2, both = 0.0, 0.0, 0.0
    for axis in range(2):
        rate = (z.nominal_force_m_s2[axis] - (before_x if axis == 0 else before_y)) / dt_s
        miss = learn_level_bias(z, axis, z.thrust_m_s2 * along[axis] - z.nominal_force_m_s2[axis], rate, dt_s)
        rate2, miss2, both = rate2 + rate * rate, miss2 + miss * miss, both + miss * rate
        z.slow_rate_m_s3[axis] += slow * (rate - z.slow_rate_m_s3[axis])
        z.slow_miss_m_s2[axis] += slow * (miss - z.slow_miss_m_s2[axis])
    share = 1.0 - exp(-dt_s / LAG_S)
    moments = z.mismatch_moments
    moments[0] += share * (rate2 - moments[0])
    moments[1] += share * (miss2 - moments[1])
    moments[2] += share * (both - moments[2])
    turned = moments[0] + RATE_M_S3 * RATE_M_S3
    shift_s = moments[2] / turned
    z.model_mismatch = sqrt(max(moments[1] / turned - shift_s * shift_s, 0.0)) / length_s
    learn_shift(z, dt_s, settings.delay_shift_most_s)


@kernel
def learn_shift(z: VehicleEstimate, dt_s: float, most_s: float) -> None:
    """The shift in time: least squares of the slow part of the miss over that of the nominal rate of change.

    Slow: behind a first-order filter of the response's length, for of what changes faster than the shift is long the
    miss says nothing about it. most_s: what of it is counted on.
    """
    rate, miss, moments = z.slow_rate_m_s3, z.slow_miss_m_s2, z.shift_moments
    share = 1.0 - exp(-dt_s / SHIFT_LAG_S)
    moments[0] += share * (rate[0] * rate[0] + rate[1] * rate[1] - moments[0])
    moments[1] += share * (miss[0] * rate[0] + miss[1] * rate[1] - moments[1])
    most = (1.0 - doubt(z.model_mismatch)) * most_s
    z.delay_shift_s = min(max(moments[1] / (moments[0] + SHIFT_RATE_M_S3 * SHIFT_RATE_M_S3), -most), most)


@kernel
def attitude_dead_s(z: VehicleEstimate, settings: ObserverSettings) -> float:
    """Dead time that is counted on of the attitude's answer, s, less the shift that was seen."""
    return max(settings.response.attitude_dead_s - z.delay_shift_s, 0.0)


@kernel
def learn_level_bias(z: VehicleEstimate, axis: int, miss: float, rate: float, dt_s: float) -> float:
    """Moves the lasting part of a miss, m/s^2, out of the force into Z3; the sum of both stays as it is. The rest.

    An autopilot is level by its own estimate, which wanders by a degree about the truth that a mocap sees: such a lean
    answers no command, so it is a disturbance of the commands, and no part of the answer to them. Of a vehicle that is
    being turned fast little is learned: what it misses then may well be an answer.
    """
    known: float = z.level_bias_m_s2[axis]
    calm = 1.0 / (1.0 + max(z.mismatch_moments[0], rate * rate) / (RATE_M_S3 * RATE_M_S3))
    learned: float = known + calm * (1.0 - exp(-dt_s / BIAS_LAG_S)) * (miss - known)
    learned = min(max(learned, -BIAS_MAX_M_S2), BIAS_MAX_M_S2)
    moved = learned - known
    z.level_bias_m_s2[axis] = learned
    z.specific_force_lab_m_s2[axis] -= moved
    z.dist_lab_m_s2[axis] += z.thrust_scale * moved
    return miss - learned


@kernel
def doubt(mismatch: float) -> float:
    """How little a vehicle is believed to be what its profile says, 0..1."""
    return min(max((mismatch - MISMATCH_FAIR) / (MISMATCH_BAD - MISMATCH_FAIR), 0.0), 1.0)

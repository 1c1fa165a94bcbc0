"""The specific force of every vehicle: how it answers what it was sent, and how that differs from its profile.

A vehicle that we command answers by a dead time, then a first-order lag, driven by the history of commands. The same
picture says what thrust was delivered so far (for the observers) and where the vehicle will be when a new command takes
hold (for the law). What differs from it is a time shift, an attitude bias, a thrust scale, or another model. Of a
quadcopter that is only observed, a recorded leader, the force is its tilt times gravity and its rise.
"""

from dataclasses import dataclass
from math import exp, sqrt
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from formation.estimation.settings import ObserverSettings
from formation.estimation.state import ModelError, VehicleEstimate
from formation.maths.arrays import Float, Layout
from formation.maths.copying import copy_into
from formation.maths.kernel import kernel
from formation.maths.quaternion import thrust_axis
from formation.maths.records import Rows, blank, like
from formation.vehicle.body import GRAVITY_M_S2

LENGTH = 128
NEVER_NS = -(1 << 60)
SECONDS = 1e-9
MISMATCH_LAG_S, RATE_M_S3 = 2.0, 3.0  # over how long the mismatch is judged; turns as slow as this say little
MISMATCH_WARN, MISMATCH_FAIR, MISMATCH_BAD = 0.38, 0.45, 0.55
SHIFT_LAG_S, SHIFT_RATE_M_S3 = 4.0, 0.25  # the same of the shift
BIAS_LAG_S, BIAS_MAX_M_S2 = 0.5, 1.0
THRUST_SCALE_LEAST, THRUST_SCALE_MOST = 0.5, 2.0  # mass, battery and propellers against the profile
UPWARD_LEAST = 0.3  # of an observed vehicle: the cosine of its tilt counts as no less


@dataclass(slots=True)
class SentCommands:
    """The last commands sent to one vehicle, oldest first; a record (formation.maths.records).

    force: specific force in `lab`, m/s^2 (what an accelerometer would feel: gravity not subtracted), then its length.
    """

    t_ns: Annotated[NDArray[np.int64], Layout(np.int64, (LENGTH,))]
    force: Annotated[Float, Layout(np.float64, (LENGTH, 4))]


def no_history(vehicles: int) -> Rows[SentCommands]:
    """Nothing was ever sent: motors off."""
    nothing = blank(SentCommands, vehicles)
    nothing["t_ns"] = NEVER_NS
    return nothing


def remember(history: Rows[SentCommands], t_ns: int, force: Float) -> Rows[SentCommands]:
    """The history with the command sent at t_ns added and the oldest forgotten; force (m, 4) as in SentCommands."""
    new = like(history)
    _remember(history, t_ns, np.ascontiguousarray(force), new)
    return new


@kernel
def _remember(history: Rows[SentCommands], t_ns: int, force: Float, new: Rows[SentCommands]) -> None:
    for i in range(len(history)):
        for k in range(LENGTH - 1):
            new[i].t_ns[k] = history[i].t_ns[k + 1]
            copy_into(history[i].force[k + 1], new[i].force[k])
        new[i].t_ns[-1] = t_ns
        copy_into(force[i], new[i].force[-1])


@kernel
def answer(
    sent_ns: NDArray[np.int64], sent: Float, from_ns: int, to_ns: int, dead_s: float, lag_s: float, force: Float,
    speed: Float, travel: Float,
) -> None:  # fmt: skip
    """Turns the specific force at from_ns into that at to_ns, with its integrals, by the exact response.

    sent_ns (h), sent (h, k): what was sent when, along k axes; force (k) in place; speed, travel (k): its single and
    double integral since from_ns. lag_s f' = sent(t - dead_s) - f.
    """
    dead_ns = int(dead_s * 1e9)
    for k in range(len(force)):
        speed[k], travel[k] = 0.0, 0.0
    t_ns = from_ns
    index = len(sent_ns) - 1
    while index > 0 and sent_ns[index] + dead_ns > t_ns:
        index -= 1
    while t_ns < to_ns:
        until = to_ns
        if index + 1 < len(sent_ns) and sent_ns[index + 1] + dead_ns < until:
            until = sent_ns[index + 1] + dead_ns
        if until > t_ns:
            h = (until - t_ns) * SECONDS
            decay = exp(-h / lag_s)
            swept = lag_s * (1.0 - decay)
            for k in range(len(force)):
                pull = sent[index, k]
                gap = force[k] - pull
                travel[k] += speed[k] * h + 0.5 * pull * h * h + gap * lag_s * (h - swept)
                speed[k] += pull * h + gap * swept
                force[k] = pull + gap * decay
        t_ns = until
        index = min(index + 1, len(sent_ns) - 1)


@kernel
def update_model_mismatch(
    z: VehicleEstimate, from_ns: int, to_ns: int, seen: bool, settings: ObserverSettings, sent: SentCommands
) -> None:
    """How much earlier, and how far otherwise, a vehicle answers than its profile says: delay shift and mismatch.

    What the nominal response alone makes of the commands is held against the force measured. The part of the miss that
    goes with the nominal rate of change is a shift in time (`learn_shift`); the rest over that rate and the response's
    length is the mismatch. Noise and a plainly slower vehicle show little; one that swings because its motors cannot
    follow shows 0.4 and more, and no shift; one that is as believed 0.36 at most.
    """
    speed, travel = np.empty(2), np.empty(2)
    error, nominal = z.model_error, z.model_error.nominal_force_m_s2
    before_x, before_y = nominal[0], nominal[1]
    dead_s, lag_s = settings.nominal_dead_s, settings.nominal_lag_s
    answer(sent.t_ns, sent.force[:, 0:2], from_ns, to_ns, dead_s, lag_s, nominal, speed, travel)
    if not seen:
        return
    along = thrust_axis(z.q_lab_from_flu)
    dt_s = (to_ns - from_ns) * SECONDS
    length_s = dead_s + lag_s
    slow = 1.0 - exp(-dt_s / length_s)
    rate2, miss2, both = 0.0, 0.0, 0.0
    for axis in range(2):
        rate = (nominal[axis] - (before_x if axis == 0 else before_y)) / dt_s
        innovation = learn_level_bias(z, axis, z.thrust_m_s2 * along[axis] - nominal[axis], rate, dt_s)
        rate2, miss2, both = rate2 + rate * rate, miss2 + innovation * innovation, both + innovation * rate
        error.slow_rate_m_s3[axis] += slow * (rate - error.slow_rate_m_s3[axis])
        error.slow_innovation_m_s2[axis] += slow * (innovation - error.slow_innovation_m_s2[axis])
    share = 1.0 - exp(-dt_s / MISMATCH_LAG_S)
    moments = error.moments
    moments[0] += share * (rate2 - moments[0])
    moments[1] += share * (miss2 - moments[1])
    moments[2] += share * (both - moments[2])
    turned = moments[0] + RATE_M_S3 * RATE_M_S3
    shift_s = moments[2] / turned
    error.mismatch = sqrt(max(moments[1] / turned - shift_s * shift_s, 0.0)) / length_s
    learn_shift(error, dt_s, settings.delay_shift_most_s)


@kernel
def learn_shift(error: ModelError, dt_s: float, most_s: float) -> None:
    """The shift in time: least squares of the slow part of the miss over that of the nominal rate of change.

    Slow: behind a first-order filter of the response's length, for of what changes faster than the shift is long the
    miss says nothing about it. most_s: what of it is counted on.
    """
    rate, innovation, moments = error.slow_rate_m_s3, error.slow_innovation_m_s2, error.shift_moments
    share = 1.0 - exp(-dt_s / SHIFT_LAG_S)
    moments[0] += share * (rate[0] * rate[0] + rate[1] * rate[1] - moments[0])
    moments[1] += share * (innovation[0] * rate[0] + innovation[1] * rate[1] - moments[1])
    most = (1.0 - doubt(error.mismatch)) * most_s
    error.delay_shift_s = min(max(moments[1] / (moments[0] + SHIFT_RATE_M_S3 * SHIFT_RATE_M_S3), -most), most)


@kernel
def attitude_dead_s(z: VehicleEstimate, settings: ObserverSettings) -> float:
    """Dead time that is counted on of the attitude's answer, s, less the shift that was seen."""
    return max(settings.response.attitude_dead_s - z.model_error.delay_shift_s, 0.0)


@kernel
def learn_level_bias(z: VehicleEstimate, axis: int, innovation: float, rate: float, dt_s: float) -> float:
    """Moves the lasting part of a miss, m/s^2, out of the force into Z3; the sum of both stays as it is. The rest.

    An autopilot's level estimate drifts by about a degree from the true level. Such an attitude bias is no response to
    a command, so it counts as a disturbance. While a vehicle turns fast, little is estimated: the innovation may then
    be part of the response.
    """
    error = z.model_error
    known: float = error.level_bias_m_s2[axis]
    calm = 1.0 / (1.0 + max(error.moments[0], rate * rate) / (RATE_M_S3 * RATE_M_S3))
    learned: float = known + calm * (1.0 - exp(-dt_s / BIAS_LAG_S)) * (innovation - known)
    learned = min(max(learned, -BIAS_MAX_M_S2), BIAS_MAX_M_S2)
    moved = learned - known
    error.level_bias_m_s2[axis] = learned
    z.specific_force_lab_m_s2[axis] -= moved
    z.dist_lab_m_s2[axis] += z.thrust_scale * moved
    return innovation - learned


@kernel
def doubt(mismatch: float) -> float:
    """How little a vehicle is believed to be what its profile says, 0..1."""
    return min(max((mismatch - MISMATCH_FAIR) / (MISMATCH_BAD - MISMATCH_FAIR), 0.0), 1.0)


@kernel
def learn_thrust_scale(z: VehicleEstimate, dt_s: float, settings: ObserverSettings) -> None:
    """Moves what Z3 holds against gravity, downwash apart, slowly into the thrust scale; their sum stays as it is."""
    share = dt_s / (settings.thrust_scale_lag_s + dt_s)
    learned = z.thrust_scale + share * (z.dist_lab_m_s2[2] - z.downwash_m_s2) / z.specific_force_lab_m_s2[2]
    learned = min(max(learned, THRUST_SCALE_LEAST), THRUST_SCALE_MOST)
    moved = learned - z.thrust_scale
    z.thrust_scale = learned
    for axis in range(3):
        z.dist_lab_m_s2[axis] -= moved * z.specific_force_lab_m_s2[axis]


@kernel
def rate_step(x: float, rate: float, measured: float, dt_s: float, w: float, decay_1_s: float) -> tuple[float, float]:
    """Value and rate of a noisy signal: an alpha-beta filter with both poles at exp(-w dt), its rate decaying."""
    pole = exp(-w * dt_s)
    x = x + dt_s * rate
    innovation = measured - x
    x = x + (1.0 - pole * pole) * innovation
    rate = (rate + (1.0 - pole) * (1.0 - pole) / dt_s * innovation) * exp(-decay_1_s * dt_s)
    return x, rate


@kernel
def observe_tilt(z: VehicleEstimate, seen: bool, dt_s: float, settings: ObserverSettings) -> None:
    """Its horizontal specific force, and the rate at which that turns, from the tilt the cameras see."""
    lift = max(GRAVITY_M_S2 + z.dist_lab_m_s2[2], 0.0)
    forward, left, upward = thrust_axis(z.q_lab_from_flu)
    up = max(upward, UPWARD_LEAST)
    measured = (forward / up, left / up)
    w = settings.tilt_bandwidth_rad_s * z.adaptive_gain
    observed = z.observed
    for axis in range(2):
        if seen:
            observed.tilt[axis], observed.tilt_rate_1_s[axis] = rate_step(
                observed.tilt[axis], observed.tilt_rate_1_s[axis], measured[axis], dt_s, w, settings.tilt_decay_1_s
            )
        z.specific_force_lab_m_s2[axis] = observed.tilt[axis] * lift
        observed.force_rate_lab_m_s3[axis] = observed.tilt_rate_1_s[axis] * lift

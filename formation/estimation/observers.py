"""The observers of one vehicle, in the order in which a frame meets them.

*Gain.* Of a vehicle that is only observed: gain = sqrt(1 + innovation^2 / (threshold^2 noise^2)), at most `most`; 1
while the filtered innovation is no more than is expected of it. The measurement's noise, estimated for every vehicle,
separates disturbance from noise. The height of one that we command: while its thrust is plainly not what is believed.

*Accelerometer.* Of a commanded vehicle, Z3 of the fast observer before the vehicle moves, along x and y of `lab`:

    innovation = R (f - thrust along z) + drag - bias - Z3_slow
    Z3_fast += weight (Z3_slow + innovation - Z3_fast),  weight = r^4 / (1 + r^4)

f: specific force, mean over one step. Rotors push along z alone, so the force across z, with the profile's drag added
back, is a disturbance, whatever the errors of the thrust and attitude models. r: the innovation over its noise limit;
the fourth power keeps the weight of noise small, and r is held for a moment. Bias (of the sensor, and of its tilt
against the markers) and noise are estimated while the weight is small. The bias follows slowly at any weight, so that a
sensor with a lasting error acts for some seconds only. Without accelerometer samples nothing changes.

*Two in parallel*, a slow and a fast FTESO (Eqs. 3-4 each), and the estimate between them:

    estimate = slow + weight (fast - slow)

r is here the largest ratio of the difference between both observers, in position, velocity and disturbance, to what the
measurement's noise alone makes of it, or the same ratio of the accelerometer's innovation. In calm air the estimate is
the slow observer's and quiet. A push shows at once, without an adaptation time. One weight serves both horizontal axes,
so that a turn of the axes changes nothing.

A push sets both apart to one side, and once more when it ends. A loop that swings by itself, because the law's gains
rise with the weight and the vehicle is slower than believed, sets them apart to one side and the other, again and
again. So reversals count against the weight: n of late leave 1 / (1 + (n / 2)^8) of it. What is late is a matter of the
observers' bandwidth, which follows the vehicle. What remains is the loop of the slow observer, whose delay margin is
known (formation.control.margin).

*What each is worth*, in mm RMS, and in m between the nearest two of twenty that cross in one point (test_kept_apart):

* fourth power: by the square, hover_gust 20.4 for 19.3, triangle_circle 0.457 for 0.413, crossing 0.153 for 0.162.
* thresholds by noise in place of likelihoods: by an interacting multiple model, hover_gust 16.0, but crossing
  0.133; with six deviations of noise for what the model misses, crossing 0.181, but hover_gust 29.3.
* reversals: nothing on these flights; it keeps the loop of a vehicle that is slower than believed from feeding itself.
"""

from math import exp, sqrt

import numpy as np

from formation.estimation.response import SECONDS
from formation.estimation.settings import ObserverGains, ObserverSettings, Parallel
from formation.estimation.state import FastObserver, VehicleEstimate
from formation.maths.arrays import Float
from formation.maths.kernel import kernel
from formation.maths.quaternion import rotate_into
from formation.paper.eq34_observer import fteso_step

NOISE_LEAST_M = 2e-5  # of a position: the least believed
NOISE_LAG_S, NOISE_SPAN_S = 0.5, 0.2  # how slowly it is learned, from how close frames
HEIGHT_LAG_S, HEIGHT_SIGMAS, HEIGHT_MOST = 0.03, 6.0, 3.0  # of a height that we command: filter, noise, the most
HEIGHT_M = 0.005  # no mass, battery or take-off makes the model miss it by more
INERTIAL_SIGMAS, INERTIAL_HOLD_S = 4.5, 0.025
INERTIAL_LAG_S, BIAS_SHARE = 2.0, 0.25  # of bias and noise; share of that rate for the bias, while the weight is large
ACCEL_NOISE_M_S2 = (0.05, 1.5)  # the least and the most that is believed
REMEMBERED = 84.0  # time constants of the fast observer, for which a change of sides is remembered
REVERSALS, SIGN_LEAST = 2.0, 0.5  # a swing's least; share of noise for a sign
PUSH_MOST_M_S2 = 14.0  # as much as Z3 may be


@kernel
def adaptive_gain(innovation: float, expected: float, most: float) -> float:
    """1 while the filtered innovation is no more than is expected of it, growing with it, at most `most`."""
    ratio = innovation / expected
    return min(sqrt(1.0 + ratio * ratio), most)


@kernel
def extrapolation_error(times_s: Float, values: Float, t_s: float, y: float) -> tuple[float, float]:
    """How far y at t_s lies off the parabola through three earlier points, and its variance per unit of noise.

    Smooth motion cancels, whatever the spacing of the stamps; what is left is measurement noise.
    """
    error, gain = y, 1.0
    for i in range(3):
        weight = 1.0
        for j in range(3):
            if j != i:
                weight *= (t_s - times_s[j]) / (times_s[i] - times_s[j])
        error -= weight * values[i]
        gain += weight * weight
    return error, gain


@kernel
def learned(var: float, square: float, share: float, least: float) -> float:
    """A variance after one more square, of which no outlier moves it far; at least that of a deviation `least`."""
    return max(var + share * (min(square, 9.0 * var) - var), least * least)


@kernel
def learn_noise(z: VehicleEstimate, to_ns: int, pos_lab_m: Float) -> None:
    """Learns the variance of the measured position from what smooth motion cannot explain."""
    noise = z.noise
    span_s = (to_ns - noise.recent_ns[0]) * SECONDS
    if span_s < NOISE_SPAN_S:
        times = np.zeros(3)
        for k in range(3):
            times[k] = (noise.recent_ns[k] - to_ns) * SECONDS
        square, gain = 0.0, 1.0
        for axis in range(3):
            error, gain = extrapolation_error(times, noise.recent_m[:, axis], 0.0, pos_lab_m[axis])
            square += error * error / gain
        share = min(span_s / (3.0 * NOISE_LAG_S), 1.0)
        noise.var_m2 = learned(noise.var_m2, square / 3.0, share, NOISE_LEAST_M)
    for k in range(3):
        noise.recent_ns[k] = noise.recent_ns[k + 1] if k < 2 else to_ns
        for axis in range(3):
            noise.recent_m[k, axis] = noise.recent_m[k + 1, axis] if k < 2 else pos_lab_m[axis]


@kernel
def filter_innovation(z: VehicleEstimate, axis: int, measured: float, model: float, dt_s: float, share: float) -> float:
    """The filtered innovation of one axis after one more position; share: of the way that the filter goes in dt_s."""
    ahead = z.pos_lab_m[axis] + dt_s * (z.vel_lab_m_s[axis] + 0.5 * dt_s * (model + z.dist_lab_m_s2[axis]))
    z.innovation_m[axis] += share * (measured - ahead - z.innovation_m[axis])
    innovation: float = z.innovation_m[axis]
    return innovation


@kernel
def adapt(z: VehicleEstimate, pos_lab_m: Float, model: Float, dt_s: float, settings: ObserverSettings) -> None:
    """Filters an observed vehicle's innovation and sets its gain: one for all axes, so that turning changes nothing.

    model (3): modelled acceleration, mean over the step.
    """
    adaptation = settings.adaptation
    share = 1.0 - exp(-dt_s / adaptation.lag_s)
    square = 0.0
    for axis in range(3):
        innovation = filter_innovation(z, axis, pos_lab_m[axis], model[axis], dt_s, share)
        square += innovation * innovation
    noise = adaptation.threshold * adaptation.threshold * z.noise.var_m2 * dt_s / (2.0 * adaptation.lag_s + dt_s)
    z.adaptive_gain = adaptive_gain(sqrt(square), sqrt(noise), adaptation.most)


@kernel
def height_gain(z: VehicleEstimate, measured_m: float, model_m_s2: float, dt_s: float) -> float:
    """How much faster to observe the height of a vehicle that we command: where its thrust is not what is believed.

    1 while the model explains the height; the filtered innovation over what it may be, at most HEIGHT_MOST.
    """
    innovation_m = filter_innovation(z, 2, measured_m, model_m_s2, dt_s, 1.0 - exp(-dt_s / HEIGHT_LAG_S))
    noise_m = HEIGHT_SIGMAS * sqrt(z.noise.var_m2 * dt_s / (2.0 * HEIGHT_LAG_S + dt_s))
    gain: float = min(max(abs(innovation_m) / max(HEIGHT_M, noise_m), 1.0), HEIGHT_MOST)
    return gain


@kernel
def blending_weight(ratio: float) -> float:
    """r^4 / (1 + r^4)."""
    square = ratio * ratio
    return square * square / (1.0 + square * square) if ratio < 1e3 else 1.0


@kernel
def receive_inertial(z: VehicleEstimate, q_before: Float, force_flu_m_s2: Float, dt_s: float, drag_1_s: Float) -> None:
    """Correct Z3 of the fast observer by one step's specific force, before the observers take the step.

    q_before (4): attitude when the step began; force_flu_m_s2 (3): mean specific force over it, NaN where it was not
    measured; drag_1_s (3): see ObserverSettings.
    """
    inertial, pair = z.inertial, z.fast
    inertial.ratio *= exp(-dt_s / INERTIAL_HOLD_S)
    if not np.isfinite(force_flu_m_s2[0] + force_flu_m_s2[1] + force_flu_m_s2[2]):
        return
    across, first, last, innovation = force_flu_m_s2.copy(), np.empty(3), np.empty(3), np.empty(2)
    across[2] -= z.thrust_scale * z.thrust_m_s2
    rotate_into(q_before, across, first)
    rotate_into(z.q_lab_from_flu, across, last)
    square = 0.0
    for axis in range(2):
        slow = z.dist_lab_m_s2[axis] - pair.weight * pair.minus_slow[2, axis]
        drag = drag_1_s[axis] * z.vel_lab_m_s[axis]
        push = 0.5 * (first[axis] + last[axis]) + drag - inertial.bias_m_s2[axis]
        innovation[axis] = min(max(push, -PUSH_MOST_M_S2), PUSH_MOST_M_S2) - slow
        square += innovation[axis] * innovation[axis]
    inertial.ratio = max(inertial.ratio, square / (INERTIAL_SIGMAS * INERTIAL_SIGMAS * inertial.var_m2_s4))
    weight = blending_weight(inertial.ratio)
    share = 1.0 - exp(-dt_s / INERTIAL_LAG_S)
    for axis in range(2):
        inertial.bias_m_s2[axis] += share * (1.0 - (1.0 - BIAS_SHARE) * weight) * innovation[axis]
        change = weight * (innovation[axis] - pair.minus_slow[2, axis])
        pair.minus_slow[2, axis] += change
        z.dist_lab_m_s2[axis] += pair.weight * change
    var = inertial.var_m2_s4 + (1.0 - weight) * share * (0.5 * square - inertial.var_m2_s4)
    least, most = ACCEL_NOISE_M_S2
    inertial.var_m2_s4 = min(max(var, least * least), most * most)


@kernel
def noise_thresholds(noise_m: float, w: float, dt_s: float, parallel: Parallel, out: Float) -> None:
    """What noise lets an observer of bandwidth w see of position, velocity and disturbance, into out (3).

    White noise of a sampled position is one of density noise^2 dt; an observer of bandwidth w passes w of it, and
    each derivative another factor w.
    """
    passed = noise_m * sqrt(min(w * dt_s, 1.0))
    out[0] = parallel.pos_sigmas * passed
    out[1] = parallel.vel_sigmas * passed * w
    out[2] = parallel.dist_sigmas * passed * w * w


@kernel
def step_both(
    z: Float, fast_minus_slow: Float, fast_weight: float, model: float, y: float, dt_s: float,
    w_slow: float, w_fast: float, gains: ObserverGains,
) -> None:  # fmt: skip
    """Both observers of one signal over one step.

    z (3): the blended estimate, which becomes the slow observer's; fast_minus_slow (3): the fast observer's less that;
    fast_weight: the weight of the fast observer in z; the rest: see `fteso_step`.
    """
    for order in range(3):
        z[order] -= fast_weight * fast_minus_slow[order]
    fast = fteso_step(
        z[0] + fast_minus_slow[0], z[1] + fast_minus_slow[1], z[2] + fast_minus_slow[2], model, y, dt_s, w_fast,
        gains.alpha, gains.scale, gains.smooth,
    )  # fmt: skip
    z[0], z[1], z[2] = fteso_step(z[0], z[1], z[2], model, y, dt_s, w_slow, gains.alpha, gains.scale, gains.smooth)
    for order in range(3):
        fast_minus_slow[order] = fast[order] - z[order]


@kernel
def count_reversals(pair: FastObserver, axis: int, ratio: float, time_constants: float) -> None:
    """Counts how often the positions of both observers have changed sides of late, along one axis.

    ratio: fast less slow, over what noise makes of it; time_constants: of the fast observer, passed since the last
    call. What is older fades with REMEMBERED of them: a slow vehicle, whose observers are slower, swings more slowly.
    """
    fade = exp(-time_constants / REMEMBERED)
    pair.push_sign[axis] *= fade
    pair.reversals[axis] *= fade
    if abs(ratio) > SIGN_LEAST:
        sign = 1.0 if ratio > 0.0 else -1.0
        pair.reversals[axis] += max(-sign * pair.push_sign[axis], 0.0)
        pair.push_sign[axis] = sign


@kernel
def observe_parallel(
    z: VehicleEstimate, measured: Float, model: Float, dt_s: float, slowed: float, slow: ObserverGains,
    parallel: Parallel,
) -> None:  # fmt: skip
    """Both observers of both horizontal axes over one step, and the estimate between them.

    measured, model (3): position and modelled acceleration; slowed: factor on both bandwidths. z keeps the estimate
    and how far the fast observer is from the slow one, so that what is moved in the estimate is moved in both.
    """
    estimate, most, pair = np.empty(3), np.empty(3), z.fast
    w_slow, w_fast = slowed * slow.bandwidth_rad_s, slowed * parallel.bandwidth_rad_s
    noise_thresholds(sqrt(z.noise.var_m2), w_fast, dt_s, parallel, most)
    square = np.zeros(3)
    weight = pair.weight
    for axis in range(2):
        estimate[0], estimate[1], estimate[2] = z.pos_lab_m[axis], z.vel_lab_m_s[axis], z.dist_lab_m_s2[axis]
        step_both(estimate, pair.minus_slow[:, axis], weight, model[axis], measured[axis], dt_s, w_slow, w_fast, slow)
        z.pos_lab_m[axis], z.vel_lab_m_s[axis], z.dist_lab_m_s2[axis] = estimate[0], estimate[1], estimate[2]
        for order in range(3):
            square[order] += pair.minus_slow[order, axis] * pair.minus_slow[order, axis]
    ratio = z.inertial.ratio
    for order in range(3):
        ratio = max(ratio, sqrt(square[order]) / most[order])
    for axis in range(2):
        count_reversals(pair, axis, pair.minus_slow[0, axis] / most[0], dt_s * parallel.bandwidth_rad_s)
    swing = max(pair.reversals[0], pair.reversals[1]) / REVERSALS
    pair.weight = blending_weight(ratio) * (1.0 - blending_weight(swing * swing))
    z.adaptive_gain = 1.0 + pair.weight * (parallel.urgency - 1.0)
    for axis in range(2):
        z.pos_lab_m[axis] += pair.weight * pair.minus_slow[0, axis]
        z.vel_lab_m_s[axis] += pair.weight * pair.minus_slow[1, axis]
        z.dist_lab_m_s2[axis] += pair.weight * pair.minus_slow[2, axis]

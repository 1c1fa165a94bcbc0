"""The innovation-adaptive gain: how much faster to observe a vehicle whose motion is not what is expected of it.

Of one that is only observed: gain = sqrt(1 + innovation^2 / (threshold^2 noise^2)), at most `most`; 1 while the
filtered innovation is no more than is expected of it. The measurement's noise, learned of every vehicle, tells a
disturbance from noise. The height of one that we command: while its thrust is plainly not what is believed.
"""

from math import exp, sqrt

import numpy as np

from formation.estimation.settings import ObserverSettings
from formation.estimation.state import VehicleEstimate
from formation.maths.arrays import Float
from formation.maths.kernel import kernel
from formation.vehicle.response import SECONDS

NOISE_LEAST_M = 2e-5  # of a position: the least believed
NOISE_LAG_S, NOISE_SPAN_S = 0.5, 0.2  # how slowly it is learned, from how close frames
HEIGHT_LAG_S, HEIGHT_SIGMAS, HEIGHT_MOST = 0.03, 6.0, 3.0  # of a height that we command: filter, noise, the most
HEIGHT_M = 0.005  # no mass, battery or take-off makes the model miss it by more


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
def learn_noise(z: VehicleEstimate, to_ns: int, pos_lab_m: Float) -> None:
    """Learns the variance of the measured position from what smooth motion cannot explain."""
    span_s = (to_ns - z.recent_ns[0]) * SECONDS
    if span_s < NOISE_SPAN_S:
        times = np.zeros(3)
        for k in range(3):
            times[k] = (z.recent_ns[k] - to_ns) * SECONDS
        square, gain = 0.0, 1.0
        for axis in range(3):
            error, gain = extrapolation_error(times, z.recent_m[:, axis], 0.0, pos_lab_m[axis])
            square += error * error / gain
        share = min(span_s / (3.0 * NOISE_LAG_S), 1.0)
        z.noise_var_m2 += share * (min(square / 3.0, 9.0 * z.noise_var_m2) - z.noise_var_m2)
        z.noise_var_m2 = max(z.noise_var_m2, NOISE_LEAST_M * NOISE_LEAST_M)
    for k in range(3):
        z.recent_ns[k] = z.recent_ns[k + 1] if k < 2 else to_ns
        for axis in range(3):
            z.recent_m[k, axis] = z.recent_m[k + 1, axis] if k < 2 else pos_lab_m[axis]


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
    noise = adaptation.threshold * adaptation.threshold * z.noise_var_m2 * dt_s / (2.0 * adaptation.lag_s + dt_s)
    z.adaptive_gain = adaptive_gain(sqrt(square), sqrt(noise), adaptation.most)


@kernel
def height_gain(z: VehicleEstimate, measured_m: float, model_m_s2: float, dt_s: float) -> float:
    """How much faster to observe the height of a vehicle that we command: where its thrust is not what is believed.

    1 while the model explains the height; the filtered innovation over what it may be, at most HEIGHT_MOST.
    """
    innovation_m = filter_innovation(z, 2, measured_m, model_m_s2, dt_s, 1.0 - exp(-dt_s / HEIGHT_LAG_S))
    noise_m = HEIGHT_SIGMAS * sqrt(z.noise_var_m2 * dt_s / (2.0 * HEIGHT_LAG_S + dt_s))
    gain: float = min(max(abs(innovation_m) / max(HEIGHT_M, noise_m), 1.0), HEIGHT_MOST)
    return gain

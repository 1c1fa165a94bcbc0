"""Two observers of one vehicle in parallel, a slow and a fast FTESO (Eqs. 3-4 each), and the estimate between them.

    estimate = slow + gate (fast - slow),  gate = r^4 / (1 + r^4)

r: the largest of what the fast one sees otherwise, in position, velocity and disturbance, over what the measurement's
noise alone lets it see, or the same of what the accelerometer feels (formation.estimation.inertial). In calm the
estimate is the slow one's, and quiet; a push is believed as soon as it shows, without waiting for anything to adapt.
One gate serves both horizontal axes, so that turning changes nothing.
"""

from math import sqrt

import numpy as np

from formation.estimation.fteso import fteso_step
from formation.estimation.settings import ObserverGains, Parallel
from formation.estimation.state import VehicleEstimate
from formation.maths.arrays import Float
from formation.maths.kernel import kernel


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
def open_gate(ratio: float) -> float:
    """r^4 / (1 + r^4)."""
    square = ratio * ratio
    return square * square / (1.0 + square * square) if ratio < 1e3 else 1.0


@kernel
def step_both(
    z: Float, spread: Float, gate: float, model: float, y: float, dt_s: float, w_slow: float, w_fast: float,
    gains: ObserverGains,
) -> None:  # fmt: skip
    """Both observers of one signal over one step.

    z (3): the estimate, which becomes the slow one's; spread (3): how far the fast one is from it; gate: of the
    estimate; the rest: see `fteso_step`.
    """
    for order in range(3):
        z[order] -= gate * spread[order]
    fast = fteso_step(
        z[0] + spread[0], z[1] + spread[1], z[2] + spread[2], model, y, dt_s, w_fast, gains.alpha, gains.scale,
        gains.smooth,
    )  # fmt: skip
    z[0], z[1], z[2] = fteso_step(z[0], z[1], z[2], model, y, dt_s, w_slow, gains.alpha, gains.scale, gains.smooth)
    for order in range(3):
        spread[order] = fast[order] - z[order]


@kernel
def observe_parallel(
    z: VehicleEstimate, measured: Float, model: Float, dt_s: float, slowed: float, slow: ObserverGains,
    parallel: Parallel,
) -> None:  # fmt: skip
    """Both observers of both horizontal axes over one step, and the estimate between them.

    measured, model (3): position and modelled acceleration; slowed: factor on both bandwidths. z keeps the estimate
    and how far the fast observer is from the slow one, so that what is moved in the estimate is moved in both.
    """
    estimate, most = np.empty(3), np.empty(3)
    w_slow, w_fast = slowed * slow.bandwidth_rad_s, slowed * parallel.bandwidth_rad_s
    noise_thresholds(sqrt(z.noise_var_m2), w_fast, dt_s, parallel, most)
    square = np.zeros(3)
    gate = z.gate
    for axis in range(2):
        estimate[0], estimate[1], estimate[2] = z.pos_lab_m[axis], z.vel_lab_m_s[axis], z.dist_lab_m_s2[axis]
        step_both(estimate, z.spread[:, axis], gate, model[axis], measured[axis], dt_s, w_slow, w_fast, slow)
        z.pos_lab_m[axis], z.vel_lab_m_s[axis], z.dist_lab_m_s2[axis] = estimate[0], estimate[1], estimate[2]
        for order in range(3):
            square[order] += z.spread[order, axis] * z.spread[order, axis]
    ratio = z.inertial_ratio
    for order in range(3):
        ratio = max(ratio, sqrt(square[order]) / most[order])
    z.gate = open_gate(ratio)
    z.adaptive_gain = 1.0 + z.gate * (parallel.urgency - 1.0)
    for axis in range(2):
        z.pos_lab_m[axis] += z.gate * z.spread[0, axis]
        z.vel_lab_m_s[axis] += z.gate * z.spread[1, axis]
        z.dist_lab_m_s2[axis] += z.gate * z.spread[2, axis]

"""The heading of one vehicle: angle, rate, and what the turn asked for misses of its acceleration."""

from math import atan2, exp, pi

import numpy as np

from formation.estimation.fteso import fteso_step
from formation.estimation.parallel import noise_thresholds, open_gate, step_both
from formation.estimation.settings import ObserverSettings
from formation.estimation.state import VehicleEstimate
from formation.maths.kernel import kernel


@kernel
def wrapped(angle: float) -> float:
    """The same angle in [-pi, pi)."""
    return (angle + pi) % (2.0 * pi) - pi


@kernel
def observe_heading(z: VehicleEstimate, seen: bool, dt_s: float, settings: ObserverSettings) -> None:
    """One step of the heading's FTESO, its angle unwrapped; unseen, the turn asked for alone, and no Z3.

    Where a second, fast one is beside it (formation.estimation.parallel), the estimate is between them.
    """
    psi, rate, dist = z.yaw_rad, z.yaw_rate_rad_s, z.yaw_dist_rad_s2
    turn = z.yaw_acc_command_rad_s2
    ahead = psi + dt_s * rate + 0.5 * dt_s * dt_s * (turn + dist)
    if not seen:
        z.yaw_rad, z.yaw_rate_rad_s, z.yaw_dist_rad_s2 = ahead, rate + dt_s * turn, 0.0
        z.yaw_spread[2] = 0.0
        return
    q = z.q_lab_from_flu
    measured = atan2(2.0 * (q[0] * q[3] + q[1] * q[2]), 1.0 - 2.0 * (q[2] * q[2] + q[3] * q[3]))
    y = ahead + wrapped(measured - ahead)
    slow, fast, gate = settings.heading, settings.heading_parallel, 0.0
    estimate = np.array((psi, rate, dist))
    if fast.bandwidth_rad_s > 0.0:
        w_slow, w_fast, most = slow.bandwidth_rad_s, fast.bandwidth_rad_s, np.empty(3)
        step_both(estimate, z.yaw_spread, open_gate(z.yaw_ratio), turn, y, dt_s, w_slow, w_fast, slow)
        noise_thresholds(settings.quiet_rad, w_fast, dt_s, fast, most)
        z.yaw_ratio *= exp(-dt_s / fast.hold_s)
        for order in range(3):
            z.yaw_ratio = max(z.yaw_ratio, abs(z.yaw_spread[order]) / most[order])
        gate = open_gate(z.yaw_ratio)
    else:
        estimate[0], estimate[1], estimate[2] = fteso_step(
            psi, rate, dist, turn, y, dt_s, slow.bandwidth_rad_s, slow.alpha, slow.scale, slow.smooth
        )
    z.yaw_rad, z.yaw_rate_rad_s = estimate[0] + gate * z.yaw_spread[0], estimate[1] + gate * z.yaw_spread[1]
    z.yaw_dist_rad_s2 = estimate[2] + gate * z.yaw_spread[2]

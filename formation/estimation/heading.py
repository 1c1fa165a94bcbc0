"""The heading of one vehicle: angle, rate, and what the turn asked for misses of its acceleration."""

from math import atan2, exp, pi

import numpy as np

from formation.estimation.fteso import fteso_step
from formation.estimation.parallel import noise_thresholds, open_gate
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
    slow, fast, gate = settings.heading, settings.heading_parallel, open_gate(z.yaw_ratio)
    slow_psi, slow_rate, slow_dist = fteso_step(
        psi - gate * z.yaw_spread[0], rate - gate * z.yaw_spread[1], dist - gate * z.yaw_spread[2], turn, y, dt_s,
        slow.bandwidth_rad_s, slow.alpha, slow.scale, slow.smooth,
    )  # fmt: skip
    if fast.bandwidth_rad_s > 0.0:
        other = 1.0 - gate  # from the estimate to the fast one
        fast_psi, fast_rate, fast_dist = fteso_step(
            psi + other * z.yaw_spread[0], rate + other * z.yaw_spread[1], dist + other * z.yaw_spread[2], turn, y,
            dt_s, fast.bandwidth_rad_s, slow.alpha, slow.scale, slow.smooth,
        )  # fmt: skip
        spread, most = z.yaw_spread, np.empty(3)
        spread[0], spread[1], spread[2] = fast_psi - slow_psi, fast_rate - slow_rate, fast_dist - slow_dist
        noise_thresholds(settings.quiet_rad, fast.bandwidth_rad_s, dt_s, fast, most)
        ratio = max(abs(spread[0]) / most[0], abs(spread[1]) / most[1], abs(spread[2]) / most[2])
        z.yaw_ratio = max(ratio, z.yaw_ratio * exp(-dt_s / fast.hold_s))
        gate = open_gate(z.yaw_ratio)
    z.yaw_rad, z.yaw_rate_rad_s = slow_psi + gate * z.yaw_spread[0], slow_rate + gate * z.yaw_spread[1]
    z.yaw_dist_rad_s2 = slow_dist + gate * z.yaw_spread[2]

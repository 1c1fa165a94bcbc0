"""The heading of one vehicle: angle, rate, and what the turn asked for misses of its acceleration."""

from math import atan2, exp, pi, sqrt

from formation.estimation.adaptive_gain import adaptive_gain
from formation.estimation.fteso import fteso_step
from formation.estimation.settings import ObserverSettings
from formation.estimation.state import VehicleEstimate
from formation.maths.kernel import kernel


@kernel
def wrapped(angle: float) -> float:
    """The same angle in [-pi, pi)."""
    return (angle + pi) % (2.0 * pi) - pi


@kernel
def observe_heading(z: VehicleEstimate, seen: bool, dt_s: float, settings: ObserverSettings) -> None:
    """One step of the heading's FTESO, its angle unwrapped; unseen, the turn asked for alone, and no Z3."""
    psi, rate, dist = z.yaw_rad, z.yaw_rate_rad_s, z.yaw_dist_rad_s2
    turn = z.yaw_acc_command_rad_s2
    ahead = psi + dt_s * rate + 0.5 * dt_s * dt_s * (turn + dist)
    if not seen:
        z.yaw_rad, z.yaw_rate_rad_s, z.yaw_dist_rad_s2 = ahead, rate + dt_s * turn, 0.0
        return
    q = z.q_lab_from_flu
    measured = atan2(2.0 * (q[0] * q[3] + q[1] * q[2]), 1.0 - 2.0 * (q[2] * q[2] + q[3] * q[3]))
    missed = wrapped(measured - ahead)
    gains, adaptation = settings.heading, settings.adaptation
    w = gains.bandwidth_rad_s
    if settings.place < 0:
        z.yaw_innovation_rad += (1.0 - exp(-dt_s / adaptation.lag_s)) * (missed - z.yaw_innovation_rad)
        noise = adaptation.threshold * settings.quiet_rad * sqrt(dt_s / (2.0 * adaptation.lag_s + dt_s))
        z.yaw_adaptive_gain = adaptive_gain(z.yaw_innovation_rad, noise, adaptation.most)
        w *= z.yaw_adaptive_gain**adaptation.bandwidth_power
    z.yaw_rad, z.yaw_rate_rad_s, z.yaw_dist_rad_s2 = fteso_step(
        psi, rate, dist, turn, ahead + missed, dt_s, w, gains.alpha, gains.scale, gains.smooth
    )

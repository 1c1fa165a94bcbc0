"""The specific force of a quadcopter that is only observed, a recorded leader: its tilt times gravity and its rise."""

from math import exp

from formation.estimation.settings import ObserverSettings
from formation.estimation.state import VehicleEstimate
from formation.maths.kernel import kernel
from formation.maths.quaternion import thrust_axis
from formation.vehicle.body import GRAVITY_M_S2

UPWARD_LEAST = 0.3


@kernel
def rate_step(x: float, rate: float, measured: float, dt_s: float, w: float, decay_1_s: float) -> tuple[float, float]:
    """Value and rate of a noisy signal: an alpha-beta filter with both poles at exp(-w dt), its rate decaying."""
    pole = exp(-w * dt_s)
    x = x + dt_s * rate
    missed = measured - x
    x = x + (1.0 - pole * pole) * missed
    rate = (rate + (1.0 - pole) * (1.0 - pole) / dt_s * missed) * exp(-decay_1_s * dt_s)
    return x, rate


@kernel
def observe_tilt(z: VehicleEstimate, seen: bool, dt_s: float, settings: ObserverSettings) -> None:
    """Its horizontal specific force, and the rate at which that turns, from the tilt the cameras see."""
    lift = max(GRAVITY_M_S2 + z.dist_lab_m_s2[2], 0.0)
    forward, left, upward = thrust_axis(z.q_lab_from_flu)
    up = max(upward, UPWARD_LEAST)
    measured = (forward / up, left / up)
    w = settings.tilt_bandwidth_rad_s * z.adaptive_gain**settings.adaptation.bandwidth_power
    for axis in range(2):
        if seen:
            z.tilt[axis], z.tilt_rate_1_s[axis] = rate_step(
                z.tilt[axis], z.tilt_rate_1_s[axis], measured[axis], dt_s, w, settings.tilt_decay_1_s
            )
        z.specific_force_lab_m_s2[axis] = z.tilt[axis] * lift
        z.force_rate_lab_m_s3[axis] = z.tilt_rate_1_s[axis] * lift

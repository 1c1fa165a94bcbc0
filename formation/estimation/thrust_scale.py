"""How strong a vehicle's thrust really is: its mass, battery and propellers against what its profile says."""

from formation.estimation.settings import ObserverSettings
from formation.estimation.state import VehicleEstimate
from formation.maths.kernel import kernel

LEAST, MOST = 0.5, 2.0


@kernel
def learn_thrust_scale(z: VehicleEstimate, dt_s: float, settings: ObserverSettings) -> None:
    """Moves what Z3 holds against gravity slowly into the thrust scale; the sum of both stays as it is."""
    share = dt_s / (settings.thrust_scale_lag_s + dt_s)
    learned = z.thrust_scale + share * z.dist_lab_m_s2[2] / z.specific_force_lab_m_s2[2]
    learned = min(max(learned, LEAST), MOST)
    moved = learned - z.thrust_scale
    z.thrust_scale = learned
    for axis in range(3):
        z.dist_lab_m_s2[axis] -= moved * z.specific_force_lab_m_s2[axis]

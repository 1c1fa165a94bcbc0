"""What the jets of the commanded vehicles do to one of them, by the poses that the ground knows."""

from math import hypot

from formation.estimation.response import SECONDS
from formation.estimation.settings import ObserverSettings
from formation.estimation.state import VehicleEstimate
from formation.maths.kernel import kernel
from formation.maths.records import Rows
from formation.vehicle.rigid_body import jet_force_n


@kernel
def downwash_m_s2(estimates: Rows[VehicleEstimate], settings: Rows[ObserverSettings], i: int, to_ns: int) -> float:
    """Modelled acceleration of vehicle i along z at to_ns, <= 0; all fly on with their velocities.

    A vehicle's jet is its thrust, as modelled: nothing of one that is only observed, whose motors nobody knows.
    """
    z, own = estimates[i], settings[i].airframe
    h, down_m_s2 = (to_ns - z.t_ns) * SECONDS, 0.0
    for j in range(len(estimates)):
        upper, other = estimates[j], settings[j].airframe
        thrust_n = other.mass_kg * upper.thrust_scale * upper.thrust_m_s2
        below_m = upper.pos_lab_m[2] - z.pos_lab_m[2] + h * (upper.vel_lab_m_s[2] - z.vel_lab_m_s[2])
        if j != i and thrust_n > 0.0 and below_m > 0.0:
            x_m = upper.pos_lab_m[0] - z.pos_lab_m[0] + h * (upper.vel_lab_m_s[0] - z.vel_lab_m_s[0])
            y_m = upper.pos_lab_m[1] - z.pos_lab_m[1] + h * (upper.vel_lab_m_s[1] - z.vel_lab_m_s[1])
            force_n = jet_force_n(hypot(x_m, y_m), below_m, thrust_n, other.reach_m, own.reach_m, own.rotor_m)
            down_m_s2 += force_n / own.mass_kg
    return -settings[i].downwash_share * down_m_s2


@kernel
def follow_downwash(
    old: Rows[VehicleEstimate], settings: Rows[ObserverSettings], i: int, airborne: bool, z: VehicleEstimate
) -> None:
    """Let Z3 of the height of vehicle i, in z, change at once by what the downwash has changed by since `old`."""
    if settings[i].commanded_index < 0:
        return
    now_m_s2 = downwash_m_s2(old, settings, i, z.t_ns) if airborne else 0.0
    z.dist_lab_m_s2[2] += now_m_s2 - z.downwash_m_s2
    z.downwash_m_s2 = now_m_s2

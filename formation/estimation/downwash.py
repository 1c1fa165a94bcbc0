"""What the jets of the commanded vehicles do to one of them, by the poses that the ground knows."""

from math import hypot

import numpy as np

from formation.estimation.settings import ObserverSettings
from formation.estimation.state import VehicleEstimate
from formation.maths.arrays import Float
from formation.maths.kernel import kernel
from formation.maths.records import Rows
from formation.vehicle.rigid_body import jet_force_n

THRUST = 6


@kernel
def jets(estimates: Rows[VehicleEstimate], settings: Rows[ObserverSettings]) -> Float:
    """Position, velocity and thrust, N, of each (n, 7): side by side, for all pairs are looked at.

    No thrust of one that is only observed: nobody knows its motors.
    """
    flying = np.empty((len(estimates), 7))
    for j in range(len(estimates)):
        z = estimates[j]
        for axis in range(3):
            flying[j, axis], flying[j, 3 + axis] = z.pos_lab_m[axis], z.vel_lab_m_s[axis]
        flying[j, THRUST] = settings[j].airframe.mass_kg * z.thrust_scale * z.thrust_m_s2
    return flying


@kernel
def downwash_m_s2(flying: Float, settings: Rows[ObserverSettings], i: int, ahead_s: float) -> float:
    """Modelled acceleration of vehicle i along z, <= 0, when all have flown on for so long as they fly in `jets`."""
    own, down_m_s2 = settings[i].airframe, 0.0
    for j in range(len(flying)):
        below_m = flying[j, 2] - flying[i, 2] + ahead_s * (flying[j, 5] - flying[i, 5])
        if below_m > 0.0:
            x_m = flying[j, 0] - flying[i, 0] + ahead_s * (flying[j, 3] - flying[i, 3])
            y_m = flying[j, 1] - flying[i, 1] + ahead_s * (flying[j, 4] - flying[i, 4])
            upper_m, aside_m = settings[j].airframe.reach_m, hypot(x_m, y_m)
            force_n = jet_force_n(aside_m, below_m, flying[j, THRUST], upper_m, own.reach_m, own.rotor_m)
            down_m_s2 += force_n / own.mass_kg
    return -settings[i].downwash_share * down_m_s2


@kernel
def follow_downwash(z: VehicleEstimate, downwash: float) -> None:
    """Let Z3 of the height change at once by what the downwash, m/s^2, has changed by."""
    z.dist_lab_m_s2[2] += downwash - z.downwash_m_s2
    z.downwash_m_s2 = downwash

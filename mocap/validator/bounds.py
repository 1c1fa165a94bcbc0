"""What each of a lab's bodies can do, as far as is known."""

from formation.config import LabConfig
from formation.maths.records import Rows, rows
from formation.vehicle.body import GRAVITY_M_S2
from formation.vehicle.path import Bounds
from formation.vehicle.profile import VehicleProfile

FASTEST_M_S = 15.0
SPIN_RAD_S = 35.0
"""The most about its own axis, with a dead motor too: what the gyros of such vehicles can say (2000 degrees/s)."""
OBSERVED = Bounds(0.05, 50.0, FASTEST_M_S, 0.25, 20.0, 0.15, 10.0, 200.0, False)
"""A body that is only observed may be anything that a hand carries or swings."""


def of_vehicle(profile: VehicleProfile) -> Bounds:
    """Full thrust and gravity together; thrice its rate about x and y: a gust may help; about z, two motors alone."""
    acc_m_s2 = profile.thrust_max_n / profile.mass_kg + GRAVITY_M_S2
    yaw_acc_rad_s2 = 0.5 * profile.thrust_max_n * profile.yaw_torque_m / profile.inertia_kg_m2[2]
    turn_rad_s = 3.0 * profile.rate_max_rad_s
    return Bounds(0.04, acc_m_s2, FASTEST_M_S, 0.2, turn_rad_s, 0.1, SPIN_RAD_S, yaw_acc_rad_s2, True)


def bounds(config: LabConfig) -> Rows[Bounds]:
    """The bounds of the lab's n vehicles."""
    kinds = [OBSERVED if v.sysid is None else of_vehicle(config.profile_of(v)) for v in config.vehicles]
    return rows(Bounds, kinds)

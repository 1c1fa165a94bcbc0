"""The downwash as the ground knows it: from estimated poses, velocities and thrusts, ahead of time."""

import numpy as np
import pytest

from formation.config import FollowerConfig, LabConfig, LeaderConfig
from formation.control.presets import preset
from formation.control.settings import observer_settings
from formation.estimation.downwash import downwash_m_s2, follow_downwash, jets
from formation.estimation.state import VehicleEstimate
from formation.maths.records import blank
from formation.vehicle.downwash import jet_force_n
from formation.vehicle.profile import CRAZYFLIE_27G as LOW
from formation.vehicle.profile import PAPER_40G as HIGH

LAB = LabConfig(
    leader=LeaderConfig(body="a", sysid=1),
    followers=(FollowerConfig(body="b", sysid=2, offset_m=(1.0, 0.0, 0.0)),),
)
SETTINGS = observer_settings(LAB, (HIGH, LOW), (preset("default"),) * 2)


def flying(thrust_m_s2: float = 9.0) -> np.ndarray:
    """The leader 0.5 m above the follower, 0.1 m aside of it and on its way to 0.05 m above it."""
    z = blank(VehicleEstimate, 2)
    z["pos_lab_m"], z["vel_lab_m_s"] = [[0.06, 0.08, 1.0], [0.0, 0.0, 0.5]], [[-0.6, -0.8, -1.0], [0.0, 0.0, 0.5]]
    z["thrust_scale"], z["thrust_m_s2"] = 1.1, thrust_m_s2
    return jets(z, SETTINGS)


@pytest.mark.parametrize(("ahead_s", "aside_m", "below_m"), [(0.0, 0.1, 0.5), (0.1, 0.0, 0.35)])
def test_the_force_is_that_of_the_jet_at_the_time(ahead_s: float, aside_m: float, below_m: float) -> None:
    force_n = jet_force_n(aside_m, below_m, 0.04 * 1.1 * 9.0, HIGH.reach_m, LOW.reach_m, LOW.rotor_radius_m)
    assert downwash_m_s2(flying(), SETTINGS, 1, ahead_s) == pytest.approx(-force_n / 0.027)
    assert downwash_m_s2(flying(), SETTINGS, 0, ahead_s) == downwash_m_s2(flying(0.0), SETTINGS, 1, ahead_s) == 0.0


def test_a_share_of_it_is_fed_forward_and_of_the_paper_nothing() -> None:
    printed = observer_settings(LAB, (HIGH, LOW), (preset("paper"),) * 2)
    assert downwash_m_s2(flying(), printed, 1, 0.0) == 0.0


def test_the_disturbance_follows_what_it_changes_by() -> None:
    z = blank(VehicleEstimate, 1)[0]
    z.dist_lab_m_s2[2] = 0.3
    for downwash, dist in ((-2.0, -1.7), (-1.5, -1.2), (0.0, 0.3)):
        follow_downwash(z, downwash)
        assert (z.dist_lab_m_s2[2], z.downwash_m_s2) == (pytest.approx(dist), downwash)

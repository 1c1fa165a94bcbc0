"""The downwash as the ground knows it: from estimated poses, velocities and thrusts, ahead of time."""

import numpy as np
import pytest

from formation.config import FollowerConfig, LabConfig, LeaderConfig
from formation.control.presets import preset
from formation.control.settings import observer_settings
from formation.estimation.downwash import THRUST, downwash_m_s2, follow_downwash, jets
from formation.estimation.state import VehicleEstimate
from formation.guidance.plan import Mode, Plan, Setpoint
from formation.guidance.shape import configured
from formation.maths.records import blank
from formation.vehicle.downwash import jet_force_n
from formation.vehicle.profile import CRAZYFLIE_27G as LOW
from formation.vehicle.profile import PAPER_40G as HIGH
from tests.formation.rig import Look, flown

LAB = LabConfig(
    leader=LeaderConfig(body="a", sysid=1),
    followers=tuple(FollowerConfig(body=b, sysid=k, offset_m=(0.0, 0.0, -0.4 * k)) for b, k in (("b", 2), ("c", 3))),
)
BODIES, HOVER = (HIGH, LOW, HIGH), np.array([HIGH.hover_thrust_norm, LOW.hover_thrust_norm, HIGH.hover_thrust_norm])
SETTINGS = observer_settings(LAB, BODIES, (preset("default"),) * 3)


def force_n(aside_m: float, below_m: float, thrust_n: float = 0.04 * 1.1 * 9.0) -> float:
    return jet_force_n(aside_m, below_m, thrust_n, HIGH.reach_m, LOW.reach_m, LOW.rotor_radius_m)


def flying() -> np.ndarray:
    """The leader 0.5 m above b, 0.1 m aside of it and on its way to 0.05 m above it; c 0.7 m above b, at rest."""
    z = blank(VehicleEstimate, 3)
    z["pos_lab_m"], z["vel_lab_m_s"][0] = [[0.36, -0.12, 1.0], [0.3, -0.2, 0.5], [0.3, -0.2, 1.2]], [-0.6, -0.8, -1.5]
    z["thrust_scale"], z["thrust_m_s2"] = 1.1, [9.0, 9.0, 0.0]
    return jets(z, SETTINGS)


@pytest.mark.parametrize(("ahead_s", "aside_m", "below_m"), [(0.0, 0.1, 0.5), (0.1, 0.0, 0.35)])
def test_the_force_is_that_of_all_jets_at_the_time(ahead_s: float, aside_m: float, below_m: float) -> None:
    """The motors of c are off, and then on."""
    now, lab = flying(), [force_n(aside_m, below_m), force_n(0.0, 0.7)]
    assert downwash_m_s2(now, SETTINGS, 1, ahead_s) == pytest.approx(-lab[0] / 0.027)
    now[2, THRUST] = now[0, THRUST]
    assert downwash_m_s2(now, SETTINGS, 1, ahead_s) == pytest.approx(-sum(lab) / 0.027)
    assert downwash_m_s2(now, SETTINGS, 2, ahead_s) == 0.0
    printed = observer_settings(LAB, BODIES, (preset("paper"),) * 3)
    assert downwash_m_s2(now, printed, 1, ahead_s) == 0.0


def test_the_disturbance_follows_what_it_changes_by() -> None:
    z = blank(VehicleEstimate, 1)[0]
    z.dist_lab_m_s2[2] = 0.3
    for downwash, dist in ((-2.0, -1.7), (-1.5, -1.2), (0.0, 0.3)):
        follow_downwash(z, downwash)
        assert (z.dist_lab_m_s2[2], z.downwash_m_s2) == (pytest.approx(dist), downwash)


@pytest.mark.parametrize("mode", [Mode.FORMATION, Mode.IDLE])
def test_the_thrust_is_there_with_the_second_frame_unless_the_floor_carries_it(mode: Mode) -> None:
    """b hovers 0.8 m under the leader. What it asks for beyond the force is against sinking till then."""
    pos, q = np.array([[0.0, 0.0, 2.0], [0.0, 0.0, 1.2], [0.0, 0.0, 0.8]]), np.tile([1.0, 0.0, 0.0, 0.0], (3, 1))
    looks = [Look((k + 1) * 10_000_000, k * 10_000_000, pos, q, np.ones(3, np.bool_)) for k in (1, 2)]
    plan = Plan((Setpoint(Mode.FORMATION), Setpoint(mode), Setpoint(mode)), configured(LAB), 1)
    with_it, without = (flown(LAB, BODIES, preset(name), plan, looks, HOVER)[-1] for name in ("default", "no_downwash"))
    share = force_n(0.0, 0.8, HIGH.weight_n) / LOW.weight_n if mode is Mode.FORMATION else 0.0
    asked = with_it.command.acc_lab_m_s2[:, 2] - without.command.acc_lab_m_s2[:, 2]
    assert asked[0] == 0.0
    assert 9.8 * share <= asked[1] <= 2.0 * 9.8 * share
    assert with_it.state.dist_lab_m_s2[1, 2] == pytest.approx(-9.8 * share, abs=0.02)

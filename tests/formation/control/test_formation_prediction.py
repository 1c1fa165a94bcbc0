"""Where a vehicle is going to be: drag slows it as the exact solution of v' = a - D v says."""

import numpy as np
import pytest

from formation.control.prediction import LawContext, motion_at
from formation.estimation.response import SentCommands, no_history, remember
from formation.estimation.settings import ObserverSettings
from formation.estimation.state import VehicleEstimate
from formation.guidance.followed_leader import as_estimated
from formation.guidance.reference_generator import VehicleReference
from formation.maths.records import Rows, blank
from formation.vehicle.body import GRAVITY_M_S2

T_NS, AHEAD_S = 10**9, 0.17
NOTHING = np.zeros((3, 4))


def _known(z: Rows[VehicleEstimate], observer: Rows[ObserverSettings], history: Rows[SentCommands]) -> LawContext:
    """Of a vehicle that is led nowhere."""
    return LawContext(z, observer, history, blank(VehicleReference, 0), NOTHING[0], NOTHING, as_estimated(NOTHING, 0))


def _predicted(vel_m_s: float, push_m_s2: float, drag_1_s: float) -> np.ndarray:
    """Position, velocity and acceleration along x, AHEAD_S later, of a vehicle told to hover at 0."""
    z, observer = blank(VehicleEstimate, 1), blank(ObserverSettings, 1)
    z["t_ns"], z["thrust_scale"], z["specific_force_lab_m_s2"] = T_NS, 1.0, [[0.0, 0.0, GRAVITY_M_S2]]
    z["vel_lab_m_s"], z["dist_lab_m_s2"] = [[vel_m_s, 0.0, 0.0]], [[push_m_s2, 0.0, 0.0]]
    observer["drag_1_s"] = [[drag_1_s, drag_1_s, 0.0]]
    observer[0].response.attitude_lag_s = observer[0].response.thrust_lag_s = 0.05
    hover = remember(no_history(1), 0, np.array([[0.0, 0.0, GRAVITY_M_S2, GRAVITY_M_S2]]))
    motion, force = np.zeros((3, 4)), np.zeros(3)
    motion_at(_known(z, observer, hover), 0, T_NS + round(AHEAD_S * 1e9), motion, force)
    assert motion[:, 1:3] == pytest.approx(np.zeros((3, 2)), abs=1e-12)
    return np.asarray(motion[:, 0])


@pytest.mark.parametrize("drag_1_s", [0.2, 1.0])
@pytest.mark.parametrize(("vel_m_s", "push_m_s2"), [(1.5, 0.0), (0.0, 2.0), (-1.0, 2.0)])
def test_drag_slows_a_vehicle_as_the_exact_solution_does(vel_m_s: float, push_m_s2: float, drag_1_s: float) -> None:
    """v = v_end + (v_0 - v_end) exp(-D h), v_end = a / D; without drag it is off by D h v, up to 0.25 m/s."""
    kept, end = np.exp(-drag_1_s * AHEAD_S), push_m_s2 / drag_1_s
    vel = end + (vel_m_s - end) * kept
    pos = end * AHEAD_S + (vel_m_s - end) * (1.0 - kept) / drag_1_s
    assert _predicted(vel_m_s, push_m_s2, drag_1_s) == pytest.approx([pos, vel, push_m_s2 - drag_1_s * vel], abs=2e-3)


def test_without_drag_it_is_newtons_law() -> None:
    assert _predicted(1.5, 2.0, 0.0) == pytest.approx([1.5 * AHEAD_S + AHEAD_S**2, 1.5 + 2.0 * AHEAD_S, 2.0])

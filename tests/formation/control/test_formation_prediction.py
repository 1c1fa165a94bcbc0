"""Where a vehicle is going to be: drag slows it as the exact solution of v' = a - D v says."""

import numpy as np
import pytest

from formation.control.prediction import LawContext, disturbance_at, motion_at
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


@pytest.mark.parametrize("weight", [1.0, 0.25])
def test_a_push_that_rises_goes_on_rising_for_a_tenth_of_a_second(weight: float) -> None:
    """d' = 20 w exp(-10 t) from d = 2 on: a filter of 5 / (50 rad/s) = 0.1 s is 2 m/s^2 behind. In steps of 0.1 ms."""
    z, observer = blank(VehicleEstimate, 1), blank(ObserverSettings, 1)
    z["t_ns"], z["thrust_scale"], z["fast"]["weight"] = T_NS, 1.0, weight
    z["dist_lab_m_s2"], z["dist_late_lab_m_s2"] = [[2.0, -2.0, 0.0]], [[0.0, 0.0]]
    observer["commanded_index"], observer[0].parallel.bandwidth_rad_s = -1, 50.0
    known, motion = _known(z, observer, no_history(1)), np.zeros((3, 4))
    motion_at(known, 0, T_NS + round(AHEAD_S * 1e9), motion, np.zeros(3))
    times_s = np.linspace(0.0, AHEAD_S, 1701)
    push = 2.0 + 2.0 * weight * (1.0 - np.exp(-10.0 * times_s))
    vel = np.concatenate([[0.0], np.cumsum(0.5 * (push[1:] + push[:-1]) * 1e-4)])
    pos = np.sum(0.5 * (vel[1:] + vel[:-1]) * 1e-4)
    assert motion[:, 0] == pytest.approx([pos, vel[-1], push[-1]], rel=1e-6)
    assert motion[:, 1] == pytest.approx(-motion[:, 0])
    assert disturbance_at(known, 0, 0, T_NS + round(AHEAD_S * 1e9)) == pytest.approx(push[-1])
    assert disturbance_at(known, 0, 0, T_NS) == 2.0


def test_without_drag_it_is_newtons_law() -> None:
    assert _predicted(1.5, 2.0, 0.0) == pytest.approx([1.5 * AHEAD_S + AHEAD_S**2, 1.5 + 2.0 * AHEAD_S, 2.0])

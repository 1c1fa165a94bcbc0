"""What an accelerometer feels: a push at once, noise hardly, a bias not for long, and nothing where there is none."""

import numpy as np
import pytest

from formation.estimation.inertial import take_inertial
from formation.estimation.state import VehicleEstimate
from formation.maths.arrays import Float, Vec3
from formation.maths.frames import from_rotation_vector, inverse, rotate
from formation.maths.records import Rows, blank

DT_S, G = 0.01, 9.8
LEVEL = np.array([1.0, 0.0, 0.0, 0.0])
UP = np.array([0.0, 0.0, G])


def _hovering(q: Float = LEVEL) -> Rows[VehicleEstimate]:
    z = blank(VehicleEstimate, 1)
    z["thrust_scale"], z["thrust_m_s2"], z["q_lab_from_flu"] = 1.0, G, q
    z["inertial_var_m2_s4"] = 0.04
    return z


def _feel(z: VehicleEstimate, force_flu_m_s2: Vec3, steps: int = 1) -> None:
    for _ in range(steps):
        take_inertial(z, z.q_lab_from_flu.copy(), force_flu_m_s2, DT_S)


def _fast_z3(z: VehicleEstimate) -> Float:
    return np.asarray(z.dist_lab_m_s2[:2] + (1.0 - z.gate) * z.spread[2, :2])


@pytest.mark.parametrize("turn", [(0.0, 0.0, 0.0), (0.2, -0.3, 0.0), (0.1, 0.4, 2.5)])
def test_a_push_is_the_fast_observers_z3_in_one_step(turn: tuple[float, float, float]) -> None:
    """Whatever way the vehicle leans and heads: what is felt besides the thrust along its own z."""
    q, push = from_rotation_vector(np.array(turn)), np.array([4.0, -3.0, 0.0])
    z = _hovering(q)
    _feel(z[0], UP + rotate(inverse(q), push))
    assert _fast_z3(z[0]) == pytest.approx(push[:2], rel=0.01)
    assert z[0].inertial_ratio > 1.0


def test_a_turn_within_the_step_is_counted_by_its_mean() -> None:
    """From 0.1 to 0.2 rad about y under a push along x: felt at 0.15 rad."""
    push, z = np.array([4.0, 0.0, 0.0]), _hovering(from_rotation_vector(np.array([0.0, 0.2, 0.0])))
    halfway = from_rotation_vector(np.array([0.0, 0.15, 0.0]))
    take_inertial(z[0], from_rotation_vector(np.array([0.0, 0.1, 0.0])), UP + rotate(inverse(halfway), push), DT_S)
    assert _fast_z3(z[0]) == pytest.approx(push[:2], abs=0.05)


def test_noise_hardly_moves_it_and_is_learned() -> None:
    rng, z, seen = np.random.default_rng(5), _hovering(), []
    for _ in range(3000):
        _feel(z[0], UP + 0.3 * rng.standard_normal(3))
        z["spread"] *= 0.8  # positions say that nothing pushes
        seen.append(_fast_z3(z[0])[0])
    assert np.sqrt(z[0].inertial_var_m2_s4) == pytest.approx(0.3, rel=0.15)
    assert np.std(seen) < 0.03


def test_a_small_bias_is_learned_and_no_push() -> None:
    z = _hovering()
    _feel(z[0], UP + np.array([0.3, -0.2, 0.0]), 1000)
    assert z[0].inertial_bias_m_s2 == pytest.approx([0.3, -0.2], rel=0.02)
    assert np.abs(_fast_z3(z[0])).max() < 0.01


def test_a_sensor_that_is_wrong_for_good_is_believed_for_some_seconds_only() -> None:
    z = _hovering()
    _feel(z[0], UP + np.array([6.0, 0.0, 0.0]), 10)
    assert _fast_z3(z[0])[0] == pytest.approx(6.0, rel=0.1)
    _feel(z[0], UP + np.array([6.0, 0.0, 0.0]), 3000)
    assert z[0].inertial_bias_m_s2[0] == pytest.approx(6.0, rel=0.1)
    assert z[0].inertial_ratio < 0.5


def test_no_more_is_believed_than_z3_may_be() -> None:
    z = _hovering()
    _feel(z[0], np.array([150.0, -150.0, 100.0]))
    assert np.abs(_fast_z3(z[0])).max() <= 14.0


def test_where_nothing_is_measured_nothing_is_different() -> None:
    z, before = _hovering(), _hovering()
    _feel(z[0], np.array([np.nan, 0.0, 0.0]), 100)
    assert z.tobytes() == before.tobytes()


def test_a_push_that_was_felt_last_is_soon_forgotten() -> None:
    z = _hovering()
    _feel(z[0], UP + np.array([4.0, 0.0, 0.0]))
    _feel(z[0], np.full(3, np.nan), 20)
    assert z[0].inertial_ratio < 0.05

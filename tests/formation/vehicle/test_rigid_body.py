"""The rigid body against Newton's and Euler's equations written with matrices."""

import numpy as np
import pytest

from formation.maths.quaternion import matrix_into
from formation.vehicle.profile import ARDUCOPTER_QUAD, PAPER_40G, PX4_QUAD, VehicleProfile
from formation.vehicle.rigid_body import add_floor, body_step, ground_effect_gain, turn
from tests.formation.oracles.body import floor, ground_effect, moved, turned
from tests.formation.oracles.frames import rotation_matrix

ODD = PAPER_40G.model_copy(update={"inertia_kg_m2": (1.1e-4, 1.7e-4, 2.4e-4), "drag_n_s_m": (0.01, 0.03, 0.02)})
BODIES = [ODD, PX4_QUAD, ARDUCOPTER_QUAD]


def state(seed: int, body: VehicleProfile, height: float) -> np.ndarray:
    rng = np.random.default_rng(seed)
    q = rng.normal(size=4) * [2.0, 0.5, 0.5, 1.0]
    q = q / np.linalg.norm(q) * (1.0 if q[0] >= 0.0 else -1.0)
    thrust = rng.uniform(0.1, 0.5, 4) * body.thrust_max_n
    return np.concatenate([[*rng.normal(size=2), height], rng.normal(size=3), q, rng.normal(size=3) * 3.0, thrust])


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("body", BODIES, ids=lambda b: b.name)
@pytest.mark.parametrize("height_m", [2.0, 0.9, 0.02, -0.001])
def test_a_step_is_newtons_and_eulers_equations(seed: int, body: VehicleProfile, height_m: float) -> None:
    x = state(seed, body, height_m * body.wheelbase_m)
    motors = np.array([0.1, 0.3, 0.2, 0.4]) * body.thrust_max_n
    push, dt = np.array([0.4, -0.3, 0.2]), 0.0015
    expected = moved(body, x, motors, push, dt)
    body_step(x, motors, body.numbers, push, dt, np.empty((5, 3)))
    np.testing.assert_allclose(x, expected, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("seed", range(4))
def test_the_floor_pushes_grips_and_turns_through_four_feet(seed: int) -> None:
    for height_m in (0.0, -0.001, 0.004, 0.02):
        x = state(seed, ODD, height_m)
        rot, force, torque = np.empty((3, 3)), np.ones(3), np.full(3, 0.5)
        matrix_into(x[6:10], rot)
        np.testing.assert_allclose(rot, rotation_matrix(x[6:10]), atol=1e-12)
        add_floor(x, rot, ODD.numbers, force, torque)
        lab, flu = floor(ODD, x)
        np.testing.assert_allclose(force, 1.0 + lab, rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(torque, 0.5 + flu, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("seed", range(4))
def test_a_turn_is_the_exponential_of_the_body_rate(seed: int) -> None:
    x = state(seed, ODD, 1.0)
    expected = turned(x[6:10], x[10:13], 0.04)
    turn(x, 0.04)
    np.testing.assert_allclose(rotation_matrix(x[6:10]), expected, atol=1e-12)
    assert x[6] >= 0.0
    still = x.copy()
    still[10:13] = 0.0
    turn(still, 0.04)
    np.testing.assert_allclose(still, [*x[:10], 0.0, 0.0, 0.0, *x[13:]], atol=1e-15)


@pytest.mark.parametrize("height_m", [-0.1, 0.0, 0.03, 0.5])
@pytest.mark.parametrize("coefficient", [0.0, 1.0, 3.0, 12.0, 20.0])
def test_ground_effect_is_cheeseman_and_bennetts_within_its_bounds(height_m: float, coefficient: float) -> None:
    assert ground_effect_gain(height_m, 0.05, coefficient) == pytest.approx(ground_effect(height_m, 0.05, coefficient))


def test_a_stopped_motor_is_still() -> None:
    x = state(1, ODD, 1.0)
    x[13:17] = [1e-13, 2e-12, 0.1, 0.0]
    body_step(x, np.zeros(4), ODD.numbers, np.zeros(3), 0.001, np.empty((5, 3)))
    assert x[13] == 0.0
    assert x[14] > 0.0

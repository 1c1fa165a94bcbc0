"""Attitude, body rates and bounds of a force, against rotation matrices and numerical derivatives."""

import numpy as np
import pytest
from oracle_attitude import Airframe, Bounds, authority_of, bounded, flat_rates, inside, turned
from oracle_frames import attitude_matrix, rotation_matrix

from formation.control.attitude import body_rates, bound_force, bound_turn, turn_authority
from formation.control.limits.fence import keep_inside
from formation.maths.quaternion import attitude_of
from formation.vehicle.profile import ARDUCOPTER_QUAD, PAPER_40G, PX4_QUAD

RNG = np.random.default_rng(11)
FORCES = [np.array([*RNG.uniform(-8.0, 8.0, 2), RNG.uniform(4.0, 14.0)]) for _ in range(12)]
YAWS = np.linspace(-3.1, 3.1, 12)


def attitude(force: np.ndarray, yaw: float) -> np.ndarray:
    q = np.empty(4)
    attitude_of(*force, yaw, q)
    assert q[0] >= 0.0
    assert np.linalg.norm(q) == pytest.approx(1.0)
    return q


@pytest.mark.parametrize(("force", "yaw"), list(zip(FORCES, YAWS, strict=True)))
def test_attitude_is_the_matrix_with_z_along_the_force(force: np.ndarray, yaw: float) -> None:
    np.testing.assert_allclose(rotation_matrix(attitude(force, yaw)), attitude_matrix(force, yaw), atol=1e-12)


@pytest.mark.parametrize(("force", "yaw"), list(zip(FORCES, YAWS, strict=True)))
def test_eq_1_gives_the_demanded_acceleration_back(force: np.ndarray, yaw: float) -> None:
    """x'' = (cos phi sin theta cos psi + sin phi sin psi) T/m and so on, with the angles of that attitude."""
    r = rotation_matrix(attitude(force, yaw))
    phi, theta, psi = np.arctan2(r[2, 1], r[2, 2]), -np.arcsin(r[2, 0]), np.arctan2(r[1, 0], r[0, 0])
    thrust = np.linalg.norm(force)
    acc = thrust * np.array([
        np.cos(phi) * np.sin(theta) * np.cos(psi) + np.sin(phi) * np.sin(psi),
        np.cos(phi) * np.sin(theta) * np.sin(psi) - np.sin(phi) * np.cos(psi),
        np.cos(phi) * np.cos(theta),
    ])  # fmt: skip
    np.testing.assert_allclose(acc, force, atol=1e-9)
    assert np.exp(1j * psi) == pytest.approx(np.exp(1j * yaw))  # x_b heads for the heading that was asked for


@pytest.mark.parametrize("yaw_rate", [0.0, -1.3])
@pytest.mark.parametrize(("force", "yaw"), list(zip(FORCES, YAWS, strict=True)))
def test_rate_feed_forward_is_the_attitudes_derivative(force: np.ndarray, yaw: float, yaw_rate: float) -> None:
    force_rate, rate = np.array([3.0, -5.0, 2.0]), np.empty(3)
    body_rates(force, force_rate, yaw, yaw_rate, rate)
    np.testing.assert_allclose(rate, flat_rates(force, force_rate, yaw, yaw_rate), atol=1e-7)


def test_yaw_rate_feed_forward_of_a_rolled_vehicle_is_shared_by_pitch_and_yaw() -> None:
    """Euler's kinematic equations at theta = 0: q = psi' sin(phi), r = psi' cos(phi)."""
    phi, yaw_rate, rate = 0.5, 1.5, np.empty(3)
    # With psi = 0 and theta = 0, z_b = (0, -sin phi, cos phi).
    force = 9.0 * np.array([0.0, -np.sin(phi), np.cos(phi)])
    body_rates(force, yaw_rate * np.cross([0.0, 0.0, 1.0], force), 0.0, yaw_rate, rate)
    np.testing.assert_allclose(rate, [0.0, yaw_rate * np.sin(phi), yaw_rate * np.cos(phi)], atol=1e-12)


@pytest.mark.parametrize("force", [*FORCES, np.array([1.0, 2.0, 2.0]), np.array([30.0, 1.0, 25.0])])
@pytest.mark.parametrize(("lift_most", "tilt"), [(15.0, 0.5), (11.0, 1.1), (30.0, 0.2)])
def test_tilt_and_thrust_bounds_put_height_before_sideways(force: np.ndarray, lift_most: float, tilt: float) -> None:
    mine = force.copy()
    bits = bound_force(mine, 4.41, lift_most, tilt)
    expected, met = bounded(force, 4.41, lift_most, tilt)
    np.testing.assert_allclose(mine, expected, rtol=1e-12)
    assert bits == met
    assert np.linalg.norm(mine) <= lift_most + 1e-9
    assert np.hypot(mine[0], mine[1]) <= mine[2] * np.tan(tilt) + 1e-9


@pytest.mark.parametrize("body", [PAPER_40G, PX4_QUAD, ARDUCOPTER_QUAD], ids=lambda b: b.name)
def test_turn_authority_is_torque_over_inertia_over_the_loops_gains(body) -> None:
    same = Airframe(
        body.mass_kg, body.inertia_kg_m2, body.wheelbase_m, body.thrust_curve, body.attitude_p_1_s, body.yaw_p_1_s,
        body.rate_p_1_s, body.rate_max_rad_s, body.rate_feed_forward,
    )  # fmt: skip
    assert turn_authority(body) == pytest.approx(authority_of(same))


@pytest.mark.parametrize("force", FORCES)
def test_a_turn_stays_within_the_motors_torque(force: np.ndarray) -> None:
    now = np.array([0.7, -0.4, 9.0])
    for authority, full in ((0.02, 20.0), (0.05, 12.0), (1.0, 20.0), (0.02, 5.0)):
        mine = force.copy()
        bound_turn(mine, now, authority, full)
        np.testing.assert_allclose(mine, turned(force, now, authority, full), rtol=1e-12)


@pytest.mark.parametrize("lands", [False, True])
@pytest.mark.parametrize("seed", range(30))
def test_the_fence_bounds_each_axis_as_braking_needs(seed: int, lands: bool) -> None:
    rng = np.random.default_rng(seed)
    low, high = np.array([-1.0, -1.5, 0.0]), np.array([1.2, 0.9, 1.4])
    motion, acc = np.zeros((3, 4)), rng.normal(size=3) * [9.0, 12.0, 7.0]
    motion[0, :3], motion[1, :3] = rng.uniform(-1.6, 1.6, 3), rng.uniform(-2.0, 2.0, 3)
    expected, met = inside(motion, acc, Bounds(0.5, low, high, 0.07), lands)
    mine = acc.copy()
    assert keep_inside(motion, low, high, 0.07, lands, mine) == met
    np.testing.assert_allclose(mine, expected, rtol=1e-12)

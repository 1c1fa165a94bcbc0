"""Attitude, body rates and thrust of a demand: against rotation matrices and derivatives, and within every limit."""

import numpy as np
import pytest

from formation.config import LabConfig
from formation.control.law import Demand
from formation.control.limits.attitude import (
    AUTHORITY_LEAST,
    body_rates,
    clamp_force,
    clamp_turn,
    lands,
    limit_force,
    limit_to_fence,
    minimum_lift,
    trusted_authority,
    turn_authority,
)
from formation.control.presets import preset
from formation.control.settings import force_limits, observer_settings
from formation.estimation.response import MISMATCH_BAD, MISMATCH_FAIR
from formation.estimation.state import VehicleEstimate
from formation.guidance.reference_generator import POINT, SLOT, VehicleReference
from formation.maths.quaternion import attitude_of
from formation.maths.records import blank
from formation.vehicle.body import GRAVITY_M_S2
from formation.vehicle.profile import PAPER_40G, PAPER_40G_PRINTED, PX4_QUAD, VehicleProfile
from tests.formation.oracles.attitude import Bounds, bounded, flat_rates, inside, turned
from tests.formation.oracles.frames import attitude_matrix, rotation_matrix

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
    bits = clamp_force(mine, 4.41, lift_most, tilt)
    expected, met = bounded(force, 4.41, lift_most, tilt)
    np.testing.assert_allclose(mine, expected, rtol=1e-12)
    assert bits == met
    assert np.linalg.norm(mine) <= lift_most + 1e-9
    assert np.hypot(mine[0], mine[1]) <= mine[2] * np.tan(tilt) + 1e-9


@pytest.mark.parametrize("force", FORCES)
def test_a_turn_stays_within_the_motors_torque(force: np.ndarray) -> None:
    now = np.array([0.7, -0.4, 9.0])
    for authority, length, full in ((0.02, 1.0, 20.0), (0.05, 0.6, 12.0), (1.0, 0.5, 20.0), (0.02, 1.0, 5.0)):
        mine = force.copy()
        clamp_turn(mine, now, authority, length, full)
        np.testing.assert_allclose(mine, turned(force, now, authority, length, full), rtol=1e-12)


@pytest.mark.parametrize("lands", [False, True])
@pytest.mark.parametrize("seed", range(30))
def test_the_fence_bounds_each_axis_as_braking_needs(seed: int, lands: bool) -> None:
    rng = np.random.default_rng(seed)
    low, high = np.array([-1.0, -1.5, 0.0]), np.array([1.2, 0.9, 1.4])
    motion, acc = np.zeros((3, 4)), rng.normal(size=3) * [9.0, 12.0, 7.0]
    motion[0, :3], motion[1, :3] = rng.uniform(-1.6, 1.6, 3), rng.uniform(-2.0, 2.0, 3)
    expected, met = inside(motion, acc, Bounds(0.5, low, high, 0.07), lands)
    mine = acc.copy()
    assert limit_to_fence(motion, low, high, 0.07, lands, mine) == met
    np.testing.assert_allclose(mine, expected, rtol=1e-12)


LAB = LabConfig.model_validate(
    {"leader": {"body": "lead"}, "followers": [{"body": "a", "sysid": 2, "offset_m": [-1.0, 0.0, 0.0]}]}
)
FULL = PAPER_40G.thrust_max_n / PAPER_40G.mass_kg
LEVEL = np.array([0.0, 0.0, GRAVITY_M_S2])


def left_of_turn(lift: float, sideways: float = 30.0, length: float = 1.0) -> float:
    """What is left of a sideways demand from level, at that lift, for the paper's vehicle."""
    force = np.array([sideways, 0.0, lift])
    clamp_turn(force, LEVEL, turn_authority(PAPER_40G), length, FULL)
    return float(force[0])


def test_a_turn_asks_for_no_more_torque_than_the_motors_hold_beside_the_lift() -> None:
    """Full motors on one side, idle on the other: (motor max - base) x arm over inertia is all there is."""
    assert left_of_turn(FULL) == 0.0
    assert left_of_turn(0.9 * FULL) < 0.5 * left_of_turn(0.5 * FULL)
    lift = 0.75 * FULL
    tilt_rad = np.arctan2(left_of_turn(lift), lift)
    torque_nm = PAPER_40G.inertia_kg_m2[0] * PAPER_40G.attitude_p_1_s * PAPER_40G.rate_p_1_s * tilt_rad
    arm_m = PAPER_40G.wheelbase_m / (2.0 * np.sqrt(2.0))
    assert torque_nm <= 0.25 * PAPER_40G.thrust_max_n * 4.0 * arm_m * 1.01


def test_a_small_turn_is_left_alone() -> None:
    assert left_of_turn(GRAVITY_M_S2, 0.5) == 0.5


@pytest.mark.parametrize("thrust_scale", [1.0, 0.8])
def test_the_force_asked_for_carries_weight_and_drag(thrust_scale: float) -> None:
    """u = g(x)^-1 (a - f(x)) of Eq. (7): 0.9 m/s along x and -0.4 m/s down at 1 1/s are 0.9 and -0.4 m/s^2 more."""
    settings = force_limits(LAB, (PX4_QUAD, PX4_QUAD))[0]
    wanted, estimates = blank(Demand, 1)[0], blank(VehicleEstimate, 2)
    wanted.acc_lab_m_s2[:], wanted.lead_acc_lab_m_s2[:] = (0.3, 0.0, 0.2), (0.0, 0.1, 0.0)
    wanted.motion[0, :3], wanted.motion[1, :3] = (0.0, 0.0, 1.0), (0.9, 0.0, -0.4)
    wanted.specific_force_lab_m_s2[:] = LEVEL
    estimates["thrust_scale"] = thrust_scale
    aim, lead = np.zeros(3), np.zeros(3)
    full = PX4_QUAD.thrust_max_n / PX4_QUAD.mass_kg
    limit_force(settings, wanted, estimates, blank(VehicleReference, 1)[0], 10**9, full, aim, lead)
    assert aim * thrust_scale == pytest.approx([0.3 + 0.9, 0.0, 0.2 + GRAVITY_M_S2 - 0.4])
    assert (lead - aim) * thrust_scale == pytest.approx([0.0, 0.1, 0.0])


def test_a_demand_upwards_leaves_the_motors_what_turning_takes() -> None:
    """0.92 of full thrust is all that is asked for, 0.88 of that upwards."""
    settings, full = force_limits(LAB, (PX4_QUAD, PX4_QUAD))[0], PX4_QUAD.thrust_max_n / PX4_QUAD.mass_kg
    wanted, estimates, aim, lead = blank(Demand, 1)[0], blank(VehicleEstimate, 2), np.zeros(3), np.zeros(3)
    wanted.acc_lab_m_s2[2], wanted.motion[0, 2], wanted.specific_force_lab_m_s2[:] = 90.0, -9.0, LEVEL
    estimates["thrust_scale"] = 1.0
    limit_force(settings, wanted, estimates, blank(VehicleReference, 1)[0], 10**9, full, aim, lead)
    assert aim == pytest.approx([0.0, 0.0, 0.88 * 0.92 * full])


@pytest.mark.parametrize(
    ("body", "most_m_s2"),
    [
        (PAPER_40G, np.sqrt((0.92 * FULL) ** 2 - GRAVITY_M_S2**2)),  # by body rates: all that thrust leaves
        (PX4_QUAD, GRAVITY_M_S2 * np.tan(0.6)),  # by attitude: the lab's tilt
        (PAPER_40G_PRINTED, None),  # whose motors can hardly turn it
    ],
    ids=lambda each: getattr(each, "name", ""),
)
def test_what_inverts_the_lag_is_bounded_by_thrust_tilt_and_turn(body: VehicleProfile, most_m_s2: float | None) -> None:
    settings, full = force_limits(LAB, (body, body))[0], body.thrust_max_n / body.mass_kg
    wanted, estimates, aim, lead = blank(Demand, 1)[0], blank(VehicleEstimate, 2), np.zeros(3), np.zeros(3)
    wanted.lead_acc_lab_m_s2[0], wanted.motion[0, 2], wanted.specific_force_lab_m_s2[:] = 90.0, 1.0, LEVEL
    estimates["thrust_scale"] = 1.0
    limit_force(settings, wanted, estimates, blank(VehicleReference, 1)[0], 10**9, full, aim, lead)
    turned_most = np.array([30.0, 0.0, LEVEL[2]])
    clamp_turn(turned_most, LEVEL, turn_authority(body), 1.0, full)
    np.testing.assert_allclose([aim, lead], [LEVEL, [most_m_s2 or turned_most[0], 0.0, LEVEL[2]]])


def test_what_lands_is_not_pushed_down_while_it_sinks() -> None:
    """By 1 m/s^2 at most; what climbs, or has only just left the floor, by more than half of g."""
    kept = GRAVITY_M_S2 - 1.0
    assert minimum_lift(7.0, -0.3, 1.0, 1.0) == minimum_lift(7.0, 0.0, 1.0, 1.0) == pytest.approx(kept)
    assert minimum_lift(7.0, -0.3, 1.3, 1.0) == pytest.approx(kept / 1.3)
    assert minimum_lift(7.0, 0.25, 1.0, 1.0) == pytest.approx(0.5 * (kept + 0.45 * GRAVITY_M_S2))
    for airborne_s, climb_m_s in ((5.0, -0.3), (7.0, 0.5)):
        assert minimum_lift(airborne_s, climb_m_s, 1.0, 1.0) == pytest.approx(0.45 * GRAVITY_M_S2)


def test_what_lands_is_pushed_less_the_faster_it_sinks_and_never_lifted_for_it() -> None:
    """At 1 m/s it carries itself; a lab that asks for 0.8 m/s is given 1.6 before that."""
    assert minimum_lift(7.0, -0.75, 1.0, 1.0) == pytest.approx(GRAVITY_M_S2 - 0.5)
    assert minimum_lift(7.0, -1.0, 1.0, 1.0) == minimum_lift(7.0, -3.0, 1.0, 1.0) == pytest.approx(GRAVITY_M_S2)
    assert minimum_lift(7.0, -0.8, 1.0, 1.6) == pytest.approx(GRAVITY_M_S2 - 1.0)
    settings = force_limits(LAB, (PAPER_40G, PAPER_40G))
    assert settings["sink_most_m_s"] == pytest.approx(1.0)
    quick = LAB.model_copy(update={"flight": LAB.flight.model_copy(update={"descend_m_s": 0.8})})
    assert force_limits(quick, (PAPER_40G, PAPER_40G))["sink_most_m_s"] == pytest.approx(1.6)


@pytest.mark.parametrize(("kind", "z_m", "down"), [(POINT, -0.95, True), (POINT, 1.0, False), (SLOT, -0.5, False)])
def test_who_is_led_beneath_where_it_stood_lands(kind: int, z_m: float, down: bool) -> None:
    reference = blank(VehicleReference, 1)[0]
    reference.kind, reference.target[2], reference.floor_m = kind, z_m, 0.05
    assert lands(reference) == down


def test_a_preset_counts_on_its_share_of_the_answer() -> None:
    gains = preset("default")
    settings = observer_settings(LAB, (PAPER_40G, PAPER_40G), (gains, gains))[1]
    response, whole_s = settings.response, PAPER_40G.response_dead_time_s + PAPER_40G.response_lag_s
    assert settings.delay_shift_most_s == pytest.approx(0.6 * whole_s)
    assert response.attitude_dead_s == pytest.approx(gains.dead_share * PAPER_40G.response_dead_time_s)
    assert response.attitude_lag_s == pytest.approx(gains.lag_share * PAPER_40G.response_lag_s)


def test_a_vehicle_is_turned_less_the_less_it_answers_as_believed() -> None:
    assert trusted_authority(0.0) == trusted_authority(MISMATCH_FAIR) == 1.0
    assert AUTHORITY_LEAST < trusted_authority(0.5 * (MISMATCH_FAIR + MISMATCH_BAD)) < 1.0
    assert trusted_authority(5.0) == pytest.approx(AUTHORITY_LEAST)


def test_loops_twice_as_fast_are_asked_for_less_only_where_their_torque_costs_lift() -> None:
    """Four times the torque: near full thrust a quarter of the turn; up to half of it the motors just saturate."""
    for lift in (0.3 * FULL, 0.5 * FULL):
        assert left_of_turn(lift, length=0.5) == left_of_turn(lift)
    assert left_of_turn(0.999 * FULL, length=0.5) == pytest.approx(0.25 * left_of_turn(0.999 * FULL), rel=0.01)

"""The jet of one vehicle and another below it, by momentum theory in plain numbers, and against what was measured."""

from math import exp, sqrt

import numpy as np
import pytest

from formation.vehicle.downwash import jet_force_n
from formation.vehicle.profile import CRAZYFLIE_27G, PX4_QUAD, VehicleProfile, at_rest
from formation.vehicle.rigid_body import downwash_into

THRUST_N, REACH_M, ROTOR_M = 0.034 * 9.81, 0.092 / sqrt(8.0), 0.0225


def force_n(aside_m: float, below_m: float, thrust_n: float = THRUST_N, scale: float = 1.0) -> float:
    return jet_force_n(aside_m, below_m, thrust_n, scale * REACH_M, scale * REACH_M, scale * ROTOR_M)


def pushed(
    profile: VehicleProfile, *pos_m: tuple[float, float, float], low: VehicleProfile | None = None
) -> list[float]:
    """Acceleration down of hovering vehicles at these positions; low: the last of them."""
    down, profiles = np.empty(len(pos_m)), [*[profile] * (len(pos_m) - 1), low or profile]
    level = np.array([1.0, 0.0, 0.0, 0.0])
    states = [at_rest(np.array(m), level, of.weight_n / 4.0).x for m, of in zip(pos_m, profiles, strict=True)]
    downwash_into(np.array(states), np.array([of.numbers for of in profiles]), down)
    return down.tolist()


def test_the_force_on_a_crazyflie_is_as_measured() -> None:
    """34 g, 0.35 m below another: 93 mN (aerorobotics/neural-swarm, flights of two)."""
    assert force_n(0.0, 0.35) == pytest.approx(0.093, rel=0.1)


def test_the_force_by_hand() -> None:
    """0.05 m aside and 0.35 m below: variances of first width, spread and reach; four discs of 20 mm in the jet."""
    var_m2 = 1.22**2 * 0.03**2 + 0.5 * (0.081 * 0.35) ** 2 + 0.04**2
    discs = 4.0 * np.pi * 0.02**2 / (2.0 * np.pi * var_m2)
    profile = (exp(-0.5 * 0.05**2 / var_m2) - exp(-4.5)) / (1.0 - exp(-4.5))
    by_hand_n = 0.96 * 0.3 * (1.0 - exp(-discs)) * profile
    assert jet_force_n(0.05, 0.35, 0.3, 0.03, 0.04, 0.02) == pytest.approx(by_hand_n)


def test_the_jet_ends_at_its_edge_and_begins_at_the_vehicle() -> None:
    edge_m = 3.0 * sqrt(1.22**2 * REACH_M**2 + 0.5 * (0.081 * 0.35) ** 2 + REACH_M**2)
    assert force_n(edge_m * 1.001, 0.35) == force_n(0.0, 0.0) == force_n(0.0, -0.35) == 0.0
    assert 0.0 < force_n(edge_m * 0.999, 0.35) < 1e-5
    assert 0.0 < force_n(0.0, 1e-6) < 1e-4 * force_n(0.0, 0.1)
    assert pushed(PX4_QUAD, (0.0, 0.0, 1.0), (0.8, 0.0, 0.9)) == [0.0, 0.0]


def test_the_force_goes_with_disc_loading() -> None:
    """Twice as large at the same disc loading, four times the thrust: the same shares at twice the distances."""
    assert force_n(0.1, 0.7, 4.0 * THRUST_N, 2.0) == pytest.approx(4.0 * force_n(0.05, 0.35))
    assert jet_force_n(0.0, 0.35, THRUST_N, REACH_M, 0.01, 1.0) <= THRUST_N
    assert force_n(0.05, 0.35, 2.0 * THRUST_N) == pytest.approx(2.0 * force_n(0.05, 0.35))


def test_only_the_lower_one_is_pushed_whichever_side_it_is_on() -> None:
    upper, down = pushed(CRAZYFLIE_27G, (0.0, 0.0, 1.0), (0.03, 0.04, 0.6))
    assert upper == 0.0 < down
    turned = pushed(CRAZYFLIE_27G, (-0.05, 0.0, 0.6), (0.0, 0.0, 1.0))
    assert turned == pytest.approx([down, 0.0])
    low, high = CRAZYFLIE_27G, PX4_QUAD
    force_n = jet_force_n(0.05, 0.4, high.weight_n, high.reach_m, low.reach_m, low.rotor_radius_m)
    assert pushed(high, (0.0, 0.0, 1.0), (0.03, 0.04, 0.6), low=low) == pytest.approx([0.0, force_n / low.mass_kg])


def test_the_jets_of_two_add_up_less_what_the_middle_one_lost() -> None:
    one, two = pushed(CRAZYFLIE_27G, (0.0, 0.0, 1.0), (0.0, 0.0, 0.6))[1], (0.0, 0.0, 0.6)
    _, _, lowest = pushed(CRAZYFLIE_27G, (0.0, 0.0, 1.0), two, (0.0, 0.0, 0.2))
    far = pushed(CRAZYFLIE_27G, (0.0, 0.0, 1.0), (0.0, 0.0, 0.2))[1]
    assert lowest == pytest.approx(far + one * (1.0 - one / 9.8), rel=1e-9)

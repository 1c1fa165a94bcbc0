"""Demanded force within what thrust, tilt and the motors' torque can give."""

import numpy as np
import pytest
from oracle_attitude import least_lift

from formation.config import LabConfig
from formation.control.attitude import (
    AUTHORITY_LEAST,
    authority_kept,
    bound_force,
    bound_turn,
    lands,
    lift_least,
    turn_authority,
)
from formation.control.presets import preset
from formation.control.settings import attitude_settings, observer_settings
from formation.estimation.model_mismatch import MISMATCH_BAD, MISMATCH_FAIR
from formation.guidance.reference_generator import POINT, SLOT, VehicleReference
from formation.maths.records import blank
from formation.vehicle.body import GRAVITY_M_S2
from formation.vehicle.profile import PAPER_40G

LAB = LabConfig.model_validate(
    {"leader": {"body": "lead"}, "followers": [{"body": "a", "sysid": 2, "offset_m": [-1.0, 0.0, 0.0]}]}
)
FULL = PAPER_40G.thrust_max_n / PAPER_40G.mass_kg
LEVEL = np.array([0.0, 0.0, GRAVITY_M_S2])


def turned(lift: float, sideways: float = 30.0) -> float:
    """What is left of a sideways demand from level, at that lift, for the paper's vehicle."""
    force = np.array([sideways, 0.0, lift])
    bound_turn(force, LEVEL, turn_authority(PAPER_40G), FULL)
    return float(force[0])


def test_a_turn_asks_for_no_more_torque_than_the_motors_hold_beside_the_lift() -> None:
    """Full motors on one side, idle on the other: (motor max - base) x arm over inertia is all there is."""
    assert turned(FULL) == 0.0
    assert turned(0.9 * FULL) < 0.5 * turned(0.5 * FULL)
    lift = 0.75 * FULL
    tilt_rad = np.arctan2(turned(lift), lift)
    torque_nm = PAPER_40G.inertia_kg_m2[0] * PAPER_40G.attitude_p_1_s * PAPER_40G.rate_p_1_s * tilt_rad
    arm_m = PAPER_40G.wheelbase_m / (2.0 * np.sqrt(2.0))
    assert torque_nm <= 0.25 * PAPER_40G.thrust_max_n * 4.0 * arm_m * 1.01


def test_a_small_turn_is_left_alone() -> None:
    assert turned(GRAVITY_M_S2, 0.5) == 0.5


def test_height_comes_before_sideways() -> None:
    force = np.array([20.0, 0.0, 12.0])
    assert bound_force(force, 4.0, 15.0, np.radians(70.0)) > 0.0
    assert force[2] == 12.0
    assert np.linalg.norm(force) == pytest.approx(15.0)


def test_what_lands_is_not_pushed_down_while_it_sinks() -> None:
    """By 1 m/s^2 at most; what climbs, or has only just left the floor, by more than half of g."""
    kept = GRAVITY_M_S2 - 1.0
    assert lift_least(7.0, -0.3, 1.0, 1.0) == lift_least(7.0, 0.0, 1.0, 1.0) == pytest.approx(kept)
    assert lift_least(7.0, -0.3, 1.3, 1.0) == pytest.approx(kept / 1.3)
    assert lift_least(7.0, 0.25, 1.0, 1.0) == pytest.approx(0.5 * (kept + 0.45 * GRAVITY_M_S2))
    for airborne_s, climb_m_s in ((5.0, -0.3), (7.0, 0.5)):
        assert lift_least(airborne_s, climb_m_s, 1.0, 1.0) == pytest.approx(0.45 * GRAVITY_M_S2)


def test_the_least_lift_is_the_oracles() -> None:
    rng = np.random.default_rng(3)
    for airborne_s, climb_m_s, scale in rng.uniform([0.0, -2.0, 0.6], [12.0, 1.0, 1.4], (300, 3)).tolist():
        assert lift_least(airborne_s, climb_m_s, scale, 1.0) == pytest.approx(least_lift(airborne_s, climb_m_s, scale))


def test_what_lands_is_pushed_less_the_faster_it_sinks_and_never_lifted_for_it() -> None:
    """At 1 m/s it carries itself; a lab that asks for 0.8 m/s is given 1.6 before that."""
    assert lift_least(7.0, -0.75, 1.0, 1.0) == pytest.approx(GRAVITY_M_S2 - 0.5)
    assert lift_least(7.0, -1.0, 1.0, 1.0) == lift_least(7.0, -3.0, 1.0, 1.0) == pytest.approx(GRAVITY_M_S2)
    assert lift_least(7.0, -0.8, 1.0, 1.6) == pytest.approx(GRAVITY_M_S2 - 1.0)
    settings = attitude_settings(LAB, (PAPER_40G, PAPER_40G))
    assert settings["sink_most_m_s"] == pytest.approx(1.0)
    quick = LAB.model_copy(update={"flight": LAB.flight.model_copy(update={"descend_m_s": 0.8})})
    assert attitude_settings(quick, (PAPER_40G, PAPER_40G))["sink_most_m_s"] == pytest.approx(1.6)


@pytest.mark.parametrize(("kind", "z_m", "down"), [(POINT, -0.95, True), (POINT, 1.0, False), (SLOT, -0.5, False)])
def test_who_is_led_beneath_where_it_stood_lands(kind: int, z_m: float, down: bool) -> None:
    reference = blank(VehicleReference, 1)[0]
    reference.kind, reference.target[2], reference.floor_m = kind, z_m, 0.05
    assert lands(reference) == down


def test_a_preset_counts_on_its_share_of_the_answer() -> None:
    gains = preset("default")
    lab = LabConfig.model_validate({"name": "lab", "leader": {"body": "lead"}, "followers": [
        {"body": "a", "sysid": 2, "offset_m": [-1.0, 0.0, 0.0]}]})  # fmt: skip
    response = observer_settings(lab, (PAPER_40G, PAPER_40G), (gains, gains))[1].response
    assert response.attitude_dead_s == pytest.approx(gains.dead_share * PAPER_40G.response_dead_time_s)
    assert response.attitude_lag_s == pytest.approx(gains.lag_share * PAPER_40G.response_lag_s)


def test_a_vehicle_is_turned_less_the_less_it_answers_as_believed() -> None:
    assert authority_kept(0.0) == authority_kept(MISMATCH_FAIR) == 1.0
    assert AUTHORITY_LEAST < authority_kept(0.5 * (MISMATCH_FAIR + MISMATCH_BAD)) < 1.0
    assert authority_kept(5.0) == pytest.approx(AUTHORITY_LEAST)

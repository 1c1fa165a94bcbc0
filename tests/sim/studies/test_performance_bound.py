from dataclasses import replace

import numpy as np
import pytest

from formation.vehicle.profile import profile
from sim.scenario import load
from sim.studies.experiments import Experiment, Job, scenario_of
from sim.studies.performance_bound import (
    STEP_S,
    AttitudeLoop,
    GustPass,
    attitude_loop,
    gust_pass,
    least_deviation_by_attitude_m,
    least_deviation_m,
    reaction_s,
    seen_s,
)

STEADY = GustPass(np.full(500, 2.0), 1e9, 1e9, 1e-4, 100.0)  # 2 m/s^2 for a second, motors that can do anything


def test_with_all_torque_only_the_reaction_costs_anything() -> None:
    """Half the push times the reaction squared, and as far as 98 m/s^2 take to stop it."""
    moved_m, speed = 0.5 * 2.0 * 0.1**2, 2.0 * 0.1
    assert least_deviation_m(STEADY, 0.1) == pytest.approx(moved_m + speed**2 / (2.0 * 98.0), rel=0.01)


def test_an_attitude_that_answers_at_once_after_its_dead_time_costs_the_same() -> None:
    moved_m, speed = 0.5 * 2.0 * 0.1**2, 2.0 * 0.1
    at_once = least_deviation_by_attitude_m(STEADY, AttitudeLoop(0.1, 1e-6, 98.0))
    assert at_once == pytest.approx(moved_m + speed**2 / (2.0 * 98.0), rel=0.02)


def test_a_lag_costs_what_the_limit_of_tilt_does_not_let_a_law_invert() -> None:
    """Step push p, limit m, lag T, no dead time: full command from the start, so that x'' = p - m (1 - e^(-t/T)) until
    it stops, which is the farthest, if nothing pulls it back beyond there. Each step has the force of its end."""
    push, most, lag_s = 2.0, 4.0, 0.1
    t_s = np.arange(0.0, 1.0, 1e-5)
    speed = np.cumsum(push - most * -np.expm1(-t_s / lag_s)) * 1e-5
    farthest_m = float((np.cumsum(speed) * 1e-5).max())
    found = least_deviation_by_attitude_m(replace(STEADY, push_m_s2=np.full(120, push)), AttitudeLoop(0.0, lag_s, most))
    assert 0.93 * farthest_m < found <= farthest_m


@pytest.mark.parametrize(("name", "low_m", "high_m"), [("paper_40g", 0.04, 0.049), ("crazyflie_27g", 0.15, 0.20)])
def test_by_attitude_the_bound_is_near_what_perfect_knowledge_reached(name: str, low_m: float, high_m: float) -> None:
    """A law of perfect knowledge of state and push moved paper_40g by 49 mm; the fan's first pass over the place."""
    scenario = scenario_of(Job("cfc", Experiment.GUST, 1, vehicle=profile(name)))
    assert low_m < least_deviation_by_attitude_m(gust_pass(scenario), attitude_loop(scenario)) < high_m


def test_without_any_force_it_is_what_the_push_does() -> None:
    drifting = replace(STEADY, push_m_s2=np.full(50, 2.0), thrust_max_m_s2=1e-9)
    assert least_deviation_m(drifting, 0.0) == pytest.approx(0.5 * 2.0 * 0.1**2, rel=1e-6)


def test_torque_and_reaction_are_what_limits_it() -> None:
    """On a vehicle that is hard to turn."""
    gust = gust_pass(scenario_of(Job("cfc", Experiment.GUST, 1, vehicle=profile("paper_40g_printed"))))
    grown = [least_deviation_m(gust, s) for s in (0.01, 0.03, 0.05)]
    assert grown == sorted(grown)
    assert least_deviation_m(replace(gust, turn_max_rad_s2=2.0 * gust.turn_max_rad_s2), 0.03) < 0.8 * grown[1]


@pytest.mark.parametrize("name", ["paper_40g", "paper_40g_printed"])
def test_no_controller_that_knows_everything_gets_below_it(name: str) -> None:
    """Bang-bang against the true push, flown in full geometry with lagging motors and bounded body rate: an outside
    controller that searches its switching times at random, told all of the push; none comes below."""
    vehicle = profile(name)
    gust = gust_pass(scenario_of(Job("cfc", Experiment.GUST, 1, vehicle=vehicle)))
    reaction = 0.014
    bound = least_deviation_m(gust, reaction)
    rng = np.random.default_rng(7)
    best = np.inf
    for _ in range(300):
        switches = reaction + np.sort(rng.uniform(0.0, 0.5, size=6))
        signs = rng.choice([-1.0, 1.0]) * np.array([1.0, -1.0, 1.0, -1.0, 1.0, -1.0, 0.0])
        boost = rng.uniform(0.5, 1.0)
        x = v = tilt = rate = turn = 0.0
        largest = 0.0
        for k, push in enumerate(gust.push_m_s2):
            asked = (
                signs[np.searchsorted(switches, k * STEP_S)] * gust.turn_max_rad_s2 if k * STEP_S > reaction else 0.0
            )
            turn += (asked - turn) * -np.expm1(-STEP_S / gust.motor_lag_s)
            rate = float(np.clip(rate + STEP_S * turn, -gust.rate_max_rad_s, gust.rate_max_rad_s))
            tilt += STEP_S * rate
            v += STEP_S * (push + boost * gust.thrust_max_m_s2 * np.sin(tilt) - 0.2 * v)
            x += STEP_S * v
            largest = max(largest, abs(x))
        best = min(best, largest)
    assert bound < best


def test_nobody_reacts_before_the_news_has_come_and_gone() -> None:
    """8 ms cameras, 4 ms link, 2 ms inside."""
    assert reaction_s(load("hover_gust")) == pytest.approx(0.014)


def test_a_push_shows_once_it_has_moved_the_drone_by_the_noise() -> None:
    """By hand: half of 2 m/s^2 makes the mocap's 0.1 mm in 10 ms."""
    assert seen_s(load("hover_gust"), STEADY) == pytest.approx(0.01, abs=0.002)


def test_a_flight_without_a_fan_is_refused() -> None:
    with pytest.raises(ValueError, match="triangle_line has no fan"):
        gust_pass(load("triangle_line"))

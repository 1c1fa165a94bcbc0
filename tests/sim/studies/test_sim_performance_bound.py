from dataclasses import replace

import numpy as np
import pytest

from sim.scenario import load
from sim.studies.performance_bound import GustPass, gust_pass, least_deviation_m, reaction_s

STEADY = GustPass(np.full(500, 2.0), 1e9, 1e-4)  # 2 m/s^2 for a second, motors that can do anything


def test_with_all_torque_only_the_reaction_costs_anything() -> None:
    """Half the push times the reaction squared, and little more until it stands."""
    moved_m = 0.5 * 2.0 * 0.1**2
    assert moved_m < least_deviation_m(STEADY, 0.1) < 1.2 * moved_m


def test_torque_and_reaction_are_what_limits_it() -> None:
    gust = gust_pass(load("hover_gust"))
    grown = [least_deviation_m(gust, s) for s in (0.01, 0.03, 0.05)]
    assert grown == sorted(grown)
    assert least_deviation_m(replace(gust, turn_max_rad_s2=2.0 * gust.turn_max_rad_s2), 0.03) < 0.8 * grown[1]


def test_nobody_reacts_before_the_news_has_come_and_gone() -> None:
    """8 ms cameras, 5 ms half a frame, 4 ms link, 2 ms inside: 19 ms beside what it takes to be seen."""
    scenario = load("hover_gust")
    assert 0.019 < reaction_s(scenario, gust_pass(scenario)) < 0.06


def test_a_flight_without_a_fan_is_refused() -> None:
    with pytest.raises(ValueError, match="triangle_line has no fan"):
        gust_pass(load("triangle_line"))

from pathlib import Path

import numpy as np
import pytest

from bench.performance_bound import (
    STEP_S,
    AttitudeLoop,
    gust_push,
    least_deviation_by_attitude_m,
    least_deviation_m,
    main,
    turning,
)
from formation.vehicle.profile import PROFILES, profile
from sim.research.experiments import Experiment, Job, scenario_of
from sim.scenario import load
from wire.config_file import dump


@pytest.mark.parametrize("name", ["paper_40g_printed", pytest.param("paper_40g", marks=pytest.mark.nightly)])
def test_no_controller_that_knows_everything_gets_below_it(name: str) -> None:
    """Bang-bang against the true push, flown in full geometry with lagging motors and bounded body rate: an outside
    controller that searches its switching times at random, told all of the push; none comes below."""
    vehicle = profile(name)
    pushes = gust_push(scenario_of(Job("cfc", Experiment.GUST, 1, vehicle=vehicle)))
    turns = turning(vehicle)
    reaction = 0.014
    bound = least_deviation_m(pushes, turns, reaction)
    rng = np.random.default_rng(7)
    best = np.inf
    for _ in range(300):
        switches = reaction + np.sort(rng.uniform(0.0, 0.5, size=6))
        signs = rng.choice([-1.0, 1.0]) * np.array([1.0, -1.0, 1.0, -1.0, 1.0, -1.0, 0.0])
        boost = rng.uniform(0.5, 1.0)
        x = v = tilt = rate = turn = 0.0
        largest = 0.0
        for k, push in enumerate(pushes):
            asked = (
                signs[np.searchsorted(switches, k * STEP_S)] * turns.turn_max_rad_s2 if k * STEP_S > reaction else 0.0
            )
            turn += (asked - turn) * -np.expm1(-STEP_S / turns.motor_lag_s)
            rate = float(np.clip(rate + STEP_S * turn, -turns.rate_max_rad_s, turns.rate_max_rad_s))
            tilt += STEP_S * rate
            v += STEP_S * (push + boost * turns.thrust_max_m_s2 * np.sin(tilt) - 0.2 * v)
            x += STEP_S * v
            largest = max(largest, abs(x))
        best = min(best, largest)
    assert bound < best


def test_a_flight_without_a_fan_is_refused() -> None:
    with pytest.raises(ValueError, match="triangle_line has no fan"):
        gust_push(load("triangle_line"))


def test_the_bound_is_that_of_the_vehicle_asked_for(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Ten times the inertia is hard to turn; by name and by file alike."""
    own = tmp_path / "own.toml"
    own.write_text(dump(PROFILES["paper_40g_printed"]))
    bounds = []
    for name in ("paper_40g", str(own)):
        main(name)
        bounds.append(float(capsys.readouterr().out.split("by motors:")[1].split("mm at least")[0]))
    easy, hard = bounds
    assert hard > 3.0 * easy


@pytest.mark.parametrize("push_m_s2", [1.0, 3.0])
def test_a_steady_push_against_a_quick_loop(push_m_s2: float) -> None:
    """Dead for 0.1 s, then 5 m/s^2 against it at once: p t^2 / 2, and the way in which that stops it."""
    loop = AttitudeLoop(dead_s=0.1, lag_s=1e-6, most_m_s2=5.0)
    least_m = least_deviation_by_attitude_m(np.full(round(2.0 / STEP_S), push_m_s2), loop)
    by_hand_m = 0.5 * push_m_s2 * 0.1**2 + (push_m_s2 * 0.1) ** 2 / (2.0 * (5.0 - push_m_s2))
    assert least_m == pytest.approx(by_hand_m, rel=0.01)


def test_a_lag_counts_as_so_much_more_dead_time_against_a_weak_push() -> None:
    """Far from the limit the force is needed late: (1 - e^(-t / lag)) most grows like a line through the dead time."""
    quick, slow = (
        least_deviation_by_attitude_m(np.full(1000, 0.5), AttitudeLoop(0.05, lag_s, 7.0)) for lag_s in (1e-6, 0.05)
    )
    assert quick < slow < 0.5 * 0.5 * 0.15**2

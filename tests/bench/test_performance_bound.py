from pathlib import Path

import numpy as np
import pytest

from bench.performance_bound import main
from formation.vehicle.bound import STEP_S, least_deviation_m, turning
from formation.vehicle.profile import PROFILES, profile
from sim.scenario import load
from sim.studies.bound import gust_push
from sim.studies.experiments import Experiment, Job, scenario_of
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

"""An ArduPilot beside a PX4 behind one leader flies as well as two PX4s do."""

import pytest

from analysis.metrics import Summary, summarise
from sim import lockstep
from sim.scenario import TrueVehicle, load

WITHIN = 0.2


def flown(name: str, *vehicles: TrueVehicle) -> Summary:
    scenario = load(name)
    if name == "triangle_circle":
        leader = scenario.lab.leader
        one_lap = leader.model_copy(update={"trajectory": leader.trajectory.model_copy(update={"duration_s": 12.0})})
        lab = scenario.lab.model_copy(update={"leader": one_lap})
        scenario = scenario.model_copy(update={"lab": lab, "formation_s": 12.0})
    others = tuple(v for v in scenario.vehicles if v.sysid not in {vehicle.sysid for vehicle in vehicles})
    scenario = scenario.model_copy(update={"vehicles": (*others, *vehicles)})
    result, flight = lockstep.run_and_load(scenario, 7)
    assert result.outcome.result == "landed"
    return summarise(flight)


@pytest.mark.parametrize("name", ["triangle_line", "triangle_circle"])
def test_the_figures_are_those_of_one_make(name: str) -> None:
    one_make = flown(name)
    mixed = flown(name, TrueVehicle(sysid=3, autopilot="ardupilot"))
    for figure in ("formation_rms_m", "formation_max_m", "vibration_m", "altitude_rms_m"):
        assert getattr(mixed, figure) == pytest.approx(getattr(one_make, figure), rel=WITHIN), figure
    assert mixed.command_hash != one_make.command_hash

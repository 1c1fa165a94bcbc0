"""Vehicles in air that brakes them: the drag of the profile is counted on, so that turning it costs no place."""

from analysis.metrics import summarise
from formation.config import TrajectoryConfig
from formation.vehicle.profile import PX4_QUAD
from sim import lockstep
from sim.scenario import load


def test_a_circle_is_flown_as_well_through_strong_drag() -> None:
    """PX4's simulator brakes by 1 m/s^2 per m/s; Z3 alone follows that drag as it turns too late.

    The leader keeps to its circle within 0.5 mm RMS; within 10 mm where Z3 is left with the drag.
    """
    assert PX4_QUAD.drag_1_s[0] == 1.0
    scenario = load("px4_circle")
    circle = TrajectoryConfig(kind="circle", radius_m=0.3, period_s=12.0, laps=1)
    leader = scenario.lab.leader.model_copy(update={"trajectory": circle})
    lab = scenario.lab.model_copy(update={"leader": leader, "followers": scenario.lab.followers[:1]})
    drones = tuple(v for v in scenario.vehicles if v.sysid in (1, 2))
    flown, flight = lockstep.run_and_load(scenario.model_copy(update={"lab": lab, "vehicles": drones}), 7)
    summary = summarise(flight)
    assert flown.outcome.result == "landed"
    assert summary.leader_rms_m is not None
    assert summary.formation_rms_m is not None
    assert summary.leader_rms_m < 0.003
    assert summary.formation_rms_m < 0.003

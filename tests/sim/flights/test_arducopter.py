"""The shipped ArduCopter profile: what the controller assumes of it is what its own loops give, and it flies by it."""

import pytest

from analysis.identify.response import Response
from analysis.identify.vehicle import identify
from analysis.metrics import summarise
from formation.messages import Severity
from formation.vehicle.profile import ARDUCOPTER_QUAD
from sim import lockstep
from sim.scenario import TrueVehicle, flown_by, load


def test_its_response_is_the_one_identified_of_it_and_carries_a_formation() -> None:
    scenario = load("px4_circle")
    lab = flown_by(scenario.lab, ARDUCOPTER_QUAD, "default")
    path = lab.leader.trajectory.model_copy(update={"duration_s": 12.0})
    lab = lab.model_copy(update={"leader": lab.leader.model_copy(update={"trajectory": path})})
    start = scenario.true_vehicle(1).start
    vehicles = (
        TrueVehicle(sysid=1, autopilot="ardupilot", start=start),
        *(TrueVehicle(sysid=sysid, autopilot="ardupilot") for sysid in (2, 3)),
    )
    flown, flight = lockstep.run_and_load(scenario.model_copy(update={"lab": lab, "vehicles": vehicles}), 7)
    assert flown.outcome.result == "landed"
    assert not [e.text for e in flight.events.messages if e.severity <= Severity.WARNING]
    summary = summarise(flight)
    assert summary.formation_rms_m is not None
    assert summary.formation_rms_m < 0.003
    found = identify(flight).drones[0].response
    assert isinstance(found, Response)
    assert found.dead_time_s.value == pytest.approx(ARDUCOPTER_QUAD.response_dead_time_s, abs=0.008)
    assert found.lag_s.value == pytest.approx(ARDUCOPTER_QUAD.response_lag_s, abs=0.012)

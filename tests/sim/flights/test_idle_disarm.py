"""Take-offs asked for late: refused before either autopilot's own time-out disarms a drone on the floor."""

import pytest

from analysis.load import Flight
from formation.messages import Phase, Severity, Verb
from sim import lockstep
from sim.scenario import TrueVehicle, load
from sim.script import FLIGHT, Outcome, Step


def flown(autopilot: str, after_s: float) -> tuple[Outcome, Flight]:
    """The take-off is asked for so long after `arm` was; arming itself takes about two seconds of that. Two drones."""
    scenario = load("triangle_line")
    lab = scenario.lab.model_copy(update={"followers": scenario.lab.followers[:1]})
    script = (FLIGHT[0], Step(verb=Verb.TAKEOFF, phase="ARMED", after_s=after_s), Step(verb=Verb.LAND, phase="HOLD"))
    vehicles = tuple(TrueVehicle(sysid=sysid, autopilot=autopilot) for sysid in (1, 2))
    changes = {"lab": lab, "script": script, "vehicles": vehicles}
    result, flight = lockstep.run_and_load(scenario.model_copy(update=changes), 7)
    return result.outcome, flight


@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
def test_a_take_off_is_flown_or_refused_and_never_cut(autopilot: str) -> None:
    for after_s in (7.0, 8.5, 11.5):
        outcome, flight = flown(autopilot, after_s)
        phases = [span.phase for span in flight.phases]
        if Phase.TAKEOFF in phases:
            assert outcome == Outcome("landed"), after_s
        else:
            assert phases == [Phase.GROUND, Phase.ARMED, Phase.GROUND]
            assert "disarmed itself: no take-off in 10 s" in flight.phases[-1].cause
        assert not [e.text for e in flight.events.messages if e.severity < Severity.WARNING], after_s
    assert Phase.TAKEOFF not in phases

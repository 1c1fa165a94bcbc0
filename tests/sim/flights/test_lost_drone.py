"""An agent that dies in the air: the flight is lost, to the ground and to who reads its log."""

from pathlib import Path

from analysis.load import load as load_log
from analysis.outcome import outcome
from sim import lockstep
from sim.faults.fault import Family, Fault
from sim.scenario import load


def test_a_flight_whose_agent_dies_is_lost(tmp_path: Path) -> None:
    dead = Fault(family=Family.KILL, core="agent", body="left", phase="LAND", after_s=0.05)
    scenario = load("triangle_line").model_copy(update={"faults": (dead,)})
    flown = lockstep.run_to_file(scenario, 1, tmp_path / "flight.mcap")
    assert flown.outcome.result == "lost"
    assert flown.outcome.reason.startswith("the landing has taken too long: left unheard for ")
    assert outcome(load_log(tmp_path / "flight.mcap")).startswith("lost: left ")

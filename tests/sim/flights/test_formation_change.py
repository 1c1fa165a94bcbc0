"""Changes of shape in lockstep: a fast subset of `twenty_shapes`."""

from pathlib import Path

from analysis.load import load as load_flight
from analysis.metrics import summarise
from formation import topics
from formation.messages import Verb
from gcs.replay import replay
from sim import lockstep
from sim.scenario import Scenario, load
from sim.script import Step
from wire.logs.mcap_read import read_log

FOLLOWERS = 5


def five() -> Scenario:
    """The first five followers of `twenty_shapes` through two changes behind a turning leader, until they hold."""
    scenario = load("twenty_shapes")
    steps = [step for step in scenario.script if step.verb not in (Verb.SHAPE, Verb.LAND)]
    changes = (("line", 3.0), ("circle heading=40", 7.0))
    steps[3:3] = [Step(verb=Verb.SHAPE, phase="FORMATION", after_s=s, argument=shape) for shape, s in changes]
    trajectory = scenario.lab.leader.trajectory.model_copy(update={"duration_s": 10.0, "kind": "line"})
    lab = scenario.lab.model_copy(
        update={
            "leader": scenario.lab.leader.model_copy(update={"trajectory": trajectory}),
            "followers": scenario.lab.followers[:FOLLOWERS],
            "flight": scenario.lab.flight.model_copy(update={"altitude_m": 0.5}),
            "formation": scenario.lab.formation.model_copy(update={"shapes": {}}),
        }
    )
    return scenario.model_copy(update={"lab": lab, "formation_s": 10.0, "script": tuple(steps)})


def test_two_changes_behind_a_turning_leader_keep_apart_track_and_replay(tmp_path: Path) -> None:
    path = tmp_path / "flight.mcap"
    assert lockstep.run_to_file(five(), 1, path).outcome.result == "held"
    summary = summarise(load_flight(path))
    assert summary.min_separation_m is not None
    assert summary.min_separation_m > 0.3
    assert summary.formation_rms_m is not None
    assert summary.formation_rms_m < 0.005
    told = [e.message.text for e in read_log(path).entries if e.topic is topics.EVENT]
    assert [sum(text.startswith(f"shape {name} in") for text in told) for name in ("line", "circle heading=40")] == [
        1,
        1,
    ]
    assert replay(read_log(path)).identical

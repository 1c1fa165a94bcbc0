"""A follower is landed alone in a moving formation, in lockstep: guards, autopilots and control as they are."""

from pathlib import Path

import numpy as np

from analysis.load import load as load_flight
from analysis.metrics import summarise
from formation import topics
from formation.messages import Verb
from gcs.replay import replay
from sim import lockstep
from sim.scenario import Scenario, load
from sim.script import FLIGHT, Step
from wire.logs.mcap_read import read_log

ALONE_S = 4.0
RIGHT, LEFT = 2, 3


def landed_alone() -> Scenario:
    """The paper's circle for half a lap; `left` is landed alone while the leader turns."""
    scenario = load("triangle_circle")
    steps = list(FLIGHT)
    steps[3:3] = [Step(verb=Verb.LAND, phase="FORMATION", after_s=ALONE_S, argument="left")]
    trajectory = scenario.lab.leader.trajectory.model_copy(update={"duration_s": 6.0})
    lab = scenario.lab.model_copy(update={"leader": scenario.lab.leader.model_copy(update={"trajectory": trajectory})})
    return scenario.model_copy(update={"lab": lab, "formation_s": 6.0, "script": tuple(steps)})


def test_one_lands_alone_the_other_holds_its_slot_and_the_log_replays(tmp_path: Path) -> None:
    path = tmp_path / "flight.mcap"
    assert lockstep.run_to_file(landed_alone(), 1, path).outcome.result == "landed"
    log = read_log(path)
    truths = [entry.message for entry in log.entries if entry.topic is topics.TRUTH]
    last_armed_ns = {sysid: max(t.t_ns for t in truths if t.sysid == sysid and t.armed) for sysid in (1, RIGHT, LEFT)}
    assert last_armed_ns[LEFT] < last_armed_ns[RIGHT] - 2_000_000_000
    touched = next(t for t in truths if t.sysid == LEFT and t.t_ns > last_armed_ns[LEFT])
    assert touched.on_ground
    by_time = {t.t_ns: {} for t in truths}
    for t in truths:
        by_time[t.t_ns][t.sysid] = t.pos_lab_m
    apart = [
        np.linalg.norm(at[a] - at[b]) for at in by_time.values() for a, b in ((1, RIGHT), (1, LEFT), (LEFT, RIGHT))
    ]
    assert min(apart) > 0.25
    summary = summarise(load_flight(path))
    assert summary.formation_rms_m is not None
    assert summary.formation_rms_m < 0.002
    assert replay(log).identical

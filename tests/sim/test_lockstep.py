import json
import socket
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from analysis.load import Flight
from analysis.load import load as load_flight
from analysis.metrics import Summary, summarise
from formation import topics
from formation.codes import FlightResult, Outcome
from formation.messages import Phase
from gcs.replay import replay
from sim import lockstep
from sim.scenario import Scenario, TrueVehicle, load
from sim.script import FLIGHT
from sim.world import T0_NS
from tests.wire.flight import check_log
from wire.logs.mcap_read import read_log


def short(**changes: object) -> Scenario:
    """The triangle behind a leader on a small fast circle, one lap."""
    scenario = load("triangle_circle")
    trajectory = scenario.lab.leader.trajectory.model_copy(update={"period_s": 6.0, "duration_s": 6.0})
    leader = scenario.lab.leader.model_copy(update={"trajectory": trajectory})
    lab = scenario.lab.model_copy(update={"leader": leader})
    return scenario.model_copy(update={"lab": lab, "formation_s": 6.0} | changes)


def flown(scenario: Scenario, seed: int) -> tuple[Outcome, Flight, Summary]:
    result, flight = lockstep.run_and_load(scenario, seed)
    return result.outcome, flight, summarise(flight)


@pytest.fixture(scope="module")
def lap(tmp_path_factory: pytest.TempPathFactory) -> tuple[Outcome, Path]:
    """One lap, landed: the host's outcome and the log."""
    path = tmp_path_factory.mktemp("lap") / "flight.mcap"
    return lockstep.run_to_file(short(), 1, path).outcome, path


def test_scenario_and_seed_decide_every_command() -> None:
    forming = short(script=FLIGHT[:3], longest_s=7.0)
    (_, _, first), (_, _, again), (_, _, other) = (flown(forming, seed) for seed in (7, 7, 8))
    assert first.command_hash == again.command_hash
    assert first.command_hash != other.command_hash


def test_the_triangle_is_flown_and_landed(lap: tuple[Outcome, Path]) -> None:
    outcome, flight = lap[0], load_flight(lap[1])
    summary = summarise(flight)
    assert outcome == Outcome(FlightResult.LANDED)
    assert summary.outcome == outcome
    phases = [span.phase for span in flight.phases]
    assert phases == [
        Phase.GROUND, Phase.ARMED, Phase.TAKEOFF, Phase.HOLD, Phase.FORMATION, Phase.HOLD, Phase.LAND, Phase.GROUND
    ]  # fmt: skip
    assert summary.formation_rms_m is not None
    assert summary.formation_rms_m < 0.005
    assert summary.leader_rms_m is not None
    assert 0.0 < summary.leader_rms_m < 0.02
    assert summary.min_separation_m is not None
    assert summary.min_separation_m > 0.5
    for sysid in (1, 2, 3):
        assert flight.truth[sysid]["on_ground"][-1]


def test_the_log_is_whole_has_the_bytes_of_both_ways_in_order_and_replays(lap: tuple[Outcome, Path]) -> None:
    assert check_log(lap[1]).complete
    assert replay(read_log(lap[1])).identical
    flight = load_flight(lap[1])
    assert set(flight.up.sysid) == set(flight.down.sysid) == {1, 2, 3}
    assert all(np.diff(flight.up.t_s) >= 0.0)


def test_a_flight_that_does_not_end_is_aborted_and_says_so() -> None:
    outcome, _, summary = flown(short(longest_s=8.0), 1)
    assert outcome == Outcome(FlightResult.ABORTED, "not over after 8 s")
    assert summary.outcome.result is FlightResult.ABORTED


def test_a_drone_heavier_than_the_controller_believes_still_holds_its_slot() -> None:
    heavy = TrueVehicle(sysid=2, vehicle={"mass_kg": 0.048})
    outcome, flight, summary = flown(short(vehicles=(heavy,)), 1)
    assert outcome.result == "landed"
    assert summary.formation_rms_m is not None
    assert summary.formation_rms_m < 0.01
    thrust = flight.target["thrust_norm"]
    aloft = slice(len(thrust) // 2, len(thrust) // 2 + 200)
    assert np.all(thrust[aloft, 1].mean() > 1.05 * thrust[aloft, 2].mean())


def test_frames_late_lost_and_hidden_do_not_end_the_flight() -> None:
    scenario = short()
    mocap = scenario.mocap.model_copy(update={"lost_share": 0.05, "occluded_share": 0.05})
    link = scenario.link.model_copy(update={"lost_share": 0.05})
    outcome, _, summary = flown(scenario.model_copy(update={"mocap": mocap, "link": link}), 2)
    assert outcome.result == "landed"
    assert summary.formation_max_m is not None
    assert summary.formation_max_m < 0.05


def test_nothing_in_lockstep_opens_a_socket(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise AssertionError("a socket was opened")

    monkeypatch.setattr(socket, "socket", refuse)
    outcome, _, _ = flown(short(script=FLIGHT[:2], longest_s=8.0), 1)
    assert outcome.result == "held"


def test_the_metadata_says_what_was_flown() -> None:
    said = lockstep.metadata(short(), 9, "memory", T0_NS)
    assert (said["scenario"], said["seed"], said["link"]) == ("triangle_circle", "9", "memory")
    assert json.loads(said["lab"])["leader"]["body"] == "leader"
    assert not {"machine", "date"} & set(said)  # the same on every machine and day
    assert topics.TRUTH.name == "sim/truth"


WARMED = """
from mocap.sources import poses
from sim import lockstep
lockstep.warm_up_all()
print(len(poses._from_quaternions.signatures), len(poses._from_matrices.signatures))
"""


@pytest.mark.processes
def test_what_is_compiled_once_reads_every_camera_system():
    """Doctor and mocap process once compiled theirs in the lab, at the first look at the cameras."""
    done = subprocess.run([sys.executable, "-c", WARMED], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["2", "2"]  # of float64 and float32

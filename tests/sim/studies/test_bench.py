"""That the figures are told whole and hang together; how large they are is the machine's business."""

import asyncio
import io
import json

import numpy as np
import pytest
from rich.console import Console

from formation.config import LabConfig
from formation.maths import frames
from sim.cli.bench_tables import bench_tables
from sim.studies import bench
from sim.studies.bench import Bus, Parts, Result, Timing
from sim.studies.scale.call_counts import Calls, TickCalls, python_calls

SOME = Timing(1.0, 2.0, 3.0, 4)


def test_a_timing_is_of_all_its_durations() -> None:
    timing = Timing.of([3.0, 1.0, 2.0])
    assert (timing.least_us, timing.p50_us, timing.count) == (1.0, 2.0, 3)
    assert timing.p99_us == pytest.approx(2.98)


def test_what_is_timed_is_called_all_the_same_and_left_as_it_was() -> None:
    class Owner:
        def twice(self, number: int) -> int:
            return 2 * number

    before = Owner.twice
    with bench.timed(Owner, "twice") as taken_us:
        assert Owner().twice(3) == 6
    assert len(taken_us) == 1
    assert taken_us[0] > 0.0
    assert Owner.twice is before


def test_a_tick_holds_its_step_and_a_step_its_law_and_estimate() -> None:
    swarm = bench.swarm(2)
    assert swarm.estimate.count == swarm.law.count == swarm.step.count == swarm.tick.count == bench.AIRBORNE_TICKS
    assert 0.0 < swarm.estimate.least_us + swarm.law.least_us < swarm.step.least_us < swarm.tick.least_us
    assert 3.0 * swarm.law_and_estimate_us_per_drone == pytest.approx(swarm.estimate.p50_us + swarm.law.p50_us)
    assert swarm.lockstep_speed > 0.0
    assert 0 < 100.0 * (swarm.tick_calls.tick + swarm.tick_calls.receive) < swarm.python_calls


@pytest.mark.parametrize(("followers", "budget"), [(2, 170_274), (20, 1_059_216)])
def test_a_simulated_second_makes_no_more_python_calls_than_its_budget(followers: int, budget: int) -> None:
    """More than 5 % over the budget: change the code, or argue for a new budget. No load of a machine changes it."""
    assert python_calls(bench.of_size(followers)) <= 1.05 * budget


@pytest.mark.parametrize("followers", [1, 20, 21, 100, bench.FOLLOWERS_MOST])
def test_a_swarm_of_any_size_stands_within_the_fence_apart_and_with_numbers_of_its_own(followers: int) -> None:
    lab = bench.of_size(followers).lab
    LabConfig.model_validate(lab.model_dump())  # no name and no system id twice
    places = np.array([(0.0, 0.0, 0.0), *(f.offset_m for f in lab.followers)])
    assert len(places) == followers + 1
    assert np.abs(places).max() < lab.limits.fence.high_m[0] - 1.0
    gaps = np.linalg.norm(places[:, None] - places[None], axis=-1) + 10.0 * np.eye(len(places))
    assert gaps.min() >= 0.6 - 1e-9


def test_calls_are_counted_while_entered_and_only_ours() -> None:
    with Calls() as calls:
        frames.wrap_angle(np.zeros(3))
        bench.in_a_row(3)
        json.dumps({"a": [1]})
    bench.in_a_row(3)
    assert calls.count == 2


def test_codec_and_kernels_take_their_time() -> None:
    assert min(*bench.codec_us(), bench.nearest_us(), bench.separation_filter_us()) > 0.0


@pytest.mark.processes
def test_frames_are_heard_from_the_cameras_and_by_way_of_the_mocap_process() -> None:
    bus = asyncio.run(bench.bus())
    assert bus.hop.count == bus.path.count == bench.FRAMES
    assert 0.0 < bus.mocap_p50_us <= bus.mocap_p99_us
    assert min(bus.hop.least_us, bus.path.least_us) > 0.0


def test_every_figure_is_in_the_json_and_in_the_tables() -> None:
    swarm = bench.Swarm(2, SOME, SOME, SOME, SOME, TickCalls(17.0, 18.0), 7.5, 1000)
    result = Result((swarm,), Parts(11.0, 12.0, 13.0, 14.0), Bus(SOME, SOME, 15.0, 16.0))
    values = json.loads(result.to_json())
    assert values["swarms"][0]["law_and_estimate_us_per_drone"] == pytest.approx(4.0 / 3.0)
    assert values["bus"]["mocap_p99_us"] == 16.0
    console = Console(record=True, width=100, file=io.StringIO())
    for table in bench_tables(result):
        console.print(table)
    shown = console.export_text()
    for figure in ("+ 2", "1.3", "2 (1)", "7.5", "11 µs", "12 µs", "13.0 µs", "14.0 µs", "15", "16", "17", "18"):
        assert figure in shown

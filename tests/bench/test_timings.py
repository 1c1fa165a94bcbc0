"""That the figures are told whole and hang together; how large they are is the machine's business."""

import asyncio
import json

import numpy as np
import pytest

from bench import timings
from bench.call_counts import Calls, TickCalls, python_calls
from bench.timings import Bus, Parts, Result, Timing
from formation.maths import frames

SOME = Timing(1.0, 2.0, 3.0, 4)


def test_a_tick_holds_its_step_and_a_step_its_law_and_estimate() -> None:
    swarm = timings.swarm(2)
    assert swarm.estimate.count == swarm.law.count == swarm.step.count == swarm.tick.count == timings.AIRBORNE_TICKS
    assert 0.0 < swarm.estimate.least_us + swarm.law.least_us < swarm.step.least_us < swarm.tick.least_us
    assert 3.0 * swarm.law_and_estimate_us_per_drone == pytest.approx(swarm.estimate.p50_us + swarm.law.p50_us)
    assert swarm.lockstep_speed > 0.0
    assert 0 < 100.0 * (swarm.tick_calls.tick + swarm.tick_calls.receive) < swarm.python_calls


@pytest.mark.parametrize(("followers", "budget"), [(2, 133_119), (20, 798_723)])
def test_a_simulated_second_makes_no_more_python_calls_than_its_budget(followers: int, budget: int) -> None:
    """More than 5 % over the budget: change the code, or argue for a new budget. No load of a machine changes it."""
    assert python_calls(timings.of_size(followers)) <= 1.05 * budget


def test_calls_are_counted_while_entered_and_only_ours() -> None:
    with Calls() as calls:
        frames.wrap_angle(np.zeros(3))
        frames.wrap_angle(np.ones(3))
        json.dumps({"a": [1]})
    frames.wrap_angle(np.zeros(3))
    assert calls.count == 2


@pytest.mark.processes
def test_frames_are_heard_from_the_cameras_and_by_way_of_the_mocap_process() -> None:
    bus = asyncio.run(timings.bus())
    assert bus.hop.count == bus.path.count == timings.FRAMES
    assert 0.0 < bus.mocap_p50_us <= bus.mocap_p99_us
    assert min(bus.hop.least_us, bus.path.least_us) > 0.0


def test_every_figure_is_in_the_json() -> None:
    swarm = timings.Swarm(2, SOME, SOME, SOME, SOME, TickCalls(17.0, 18.0), 7.5, 1000)
    values = json.loads(Result((swarm,), Parts(11.0, 12.0, 13.0, 14.0), Bus(SOME, SOME, 15.0, 16.0)).to_json())
    assert values["swarms"][0]["law_and_estimate_us_per_drone"] == pytest.approx(4.0 / 3.0)
    assert values["bus"]["mocap_p99_us"] == 16.0

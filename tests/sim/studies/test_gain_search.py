import math
from dataclasses import astuple

import pytest
from rich.console import Console

from formation.config import MocapConfig
from formation.control.gains import CascadeGains
from formation.control.presets import Preset, preset_for
from formation.vehicle.profile import PAPER_40G
from sim import lockstep
from sim.studies import gain_search, tune
from sim.studies.experiments import Experiment, Job, scenario_of
from sim.studies.gain_search import Tried
from sim.studies.runner import Runner
from sim.studies.tune import Task

TASK = Task(PAPER_40G, rate_hz=100.0, delay_s=0.008, noise_m=0.0001)


@pytest.mark.parametrize(("name", "count"), [("pid", 8), ("geometric", 10), ("default", 10)])
def test_neighbours_move_one_gain_or_the_observer_by_one_step(name: str, count: int) -> None:
    gains = preset_for(name, PAPER_40G, MocapConfig())
    found = list(gain_search.neighbours(gains, 2.0))
    assert len(found) == len({str(one) for one in found}) == count
    for one in found:
        was = [*astuple(gains.follower), gains.observer.bandwidth_rad_s]
        now = [*astuple(one.follower), one.observer.bandwidth_rad_s]
        assert [b / a for a, b in zip(was, now, strict=True) if a != b] in ([2.0], [0.5])
        assert (one.leader, one.follower_vertical) == (gains.leader, gains.follower_vertical)


def test_the_search_finds_the_gains_that_cost_least(monkeypatch: pytest.MonkeyPatch) -> None:
    """A bowl whose floor lies at 3, 5, 2 stands in for the flights."""

    def bowl(_task: Task, presets: list[Preset], _runner: Runner) -> list[Tried]:
        def cost(gains: Preset) -> float:
            assert isinstance(gains.follower, CascadeGains)
            law = gains.follower
            return 1.0 + sum(math.log(x / w) ** 2 for x, w in ((law.kp_position, 3.0), (law.kp, 5.0), (law.ki, 2.0)))

        return [Tried(gains, cost(gains)) for gains in presets]

    monkeypatch.setattr(gain_search, "judge", bowl)
    told: list[Tried] = []
    best = gain_search.search(TASK, "pid", Runner(Console(quiet=True)), told.append)
    assert best.cost < 1.05 < told[0].cost
    assert told[-1] == best
    assert isinstance(best.gains.follower, CascadeGains)
    assert best.gains.follower.kp_position == pytest.approx(3.0, rel=0.2)


def test_an_unknown_law_is_refused_by_name() -> None:
    with pytest.raises(ValueError, match="unknown control preset 'pdi'"):
        gain_search.search(TASK, "pdi", Runner(Console(quiet=True)), lambda _: None)


def test_the_gains_tried_are_those_that_fly() -> None:
    """Those of the lab's own preset fly the same flight, bit by bit, and others do not."""
    scenario = scenario_of(Job("pid", Experiment.GUST, 1)).model_copy(update={"longest_s": 8.0})
    own = preset_for("pid", PAPER_40G, scenario.lab.mocap)
    other = next(gain_search.neighbours(own, 2.0))
    plain, tried, apart = (
        lockstep.run_and_load(scenario, 1, gains=gains)[1].target.column(lambda m: m.q_lab_from_flu[0]).tolist()
        for gains in (None, own, other)
    )
    assert plain == tried != apart


def test_a_candidate_costs_all_of_its_flights(monkeypatch: pytest.MonkeyPatch) -> None:
    flown: list[tune.Flight] = []

    def cost(flight: tune.Flight) -> float:
        flown.append(flight)
        return 1.0 if flight.off else 0.5

    monkeypatch.setattr(gain_search, "fly", cost)
    own = preset_for("pid", PAPER_40G, MocapConfig())
    (tried,) = gain_search.judge(TASK, [own], Runner(Console(quiet=True), workers=1))
    assert tried == Tried(own, 4.5)
    assert {(f.experiment, f.off) for f in flown} == {
        (e, off) for e in (Experiment.GUST, Experiment.CIRCLE, Experiment.PUSH) for off in (False, True)
    }
    assert all(f.gains is own for f in flown)

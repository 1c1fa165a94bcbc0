import math
from collections.abc import Sequence
from pathlib import Path

import pytest
from rich.console import Console

from formation.control.gains import CascadeGains
from formation.control.presets import Preset, preset_for
from formation.vehicle.profile import PAPER_40G
from sim.research import gain_search, host, league, tune
from sim.research.experiments import Experiment, Job, scenario_of
from sim.research.gain_search import Tried
from sim.research.laws import ChosenLaw
from sim.research.league import Row
from sim.research.tune import Flight, Task
from sim.runner import Runner

LAW = """
class Law:
    def __init__(self, k=1.0, d=4.0, off=0.0, n=3):
        if d > 4.7:
            raise ValueError("d is too large")

    def __call__(self, at):
        return [0.0, 0.0, 0.0]
"""
WANTED = (("k", 3.0), ("d", 5.0))
TASK = Task(PAPER_40G, rate_hz=100.0, delay_s=0.008)


def test_the_search_finds_the_gains_that_cost_least(monkeypatch: pytest.MonkeyPatch) -> None:
    """A bowl whose floor lies at 3, 5, 2 stands in for the flights."""

    def bowl(_task: Task, presets: Sequence[Preset], _runner: Runner, _worth: float = math.inf) -> list[Tried]:
        def cost(gains: Preset) -> float:
            assert isinstance(gains.follower, CascadeGains)
            law = gains.follower
            return 1.0 + sum(math.log(x / w) ** 2 for x, w in ((law.kp_position, 3.0), (law.kp, 5.0), (law.ki, 2.0)))

        return [Tried(gains, cost(gains), 1) for gains in presets]

    monkeypatch.setattr(gain_search, "judge", bowl)
    told: list[Tried] = []
    best = gain_search.search(TASK, ChosenLaw("pid"), Runner(Console(quiet=True)), told.append)
    assert best.cost < 1.05 < told[0].cost
    assert told[-1] == best
    assert isinstance(best.law, Preset)
    assert isinstance(best.law.follower, CascadeGains)
    assert best.law.follower.kp_position == pytest.approx(3.0, rel=0.2)


def test_an_own_law_is_searched_by_its_options(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """A bowl whose floor lies at 3 and 5; what the law refuses is not tried."""
    (tmp_path / "law.py").write_text(LAW)

    def bowl(_task: Task, laws: Sequence[ChosenLaw], _runner: Runner, _worth: float = math.inf) -> list[Tried]:
        assert len(laws) <= 4
        return [Tried(law, 1.0 + sum(math.log(dict(law.law)[k] / w) ** 2 for k, w in WANTED), 1) for law in laws]

    monkeypatch.setattr(gain_search, "judge", bowl)
    law = ChosenLaw(str(tmp_path / "law.py"))
    assert law.options() == {"k": 1.0, "d": 4.0}
    best = gain_search.search(TASK, law, Runner(Console(quiet=True)), lambda _found: None)
    assert gain_search.gains_of(best.law)["k"] == pytest.approx(3.0, rel=0.2)
    assert gain_search.gains_of(best.law)["d"] == pytest.approx(4.5, rel=0.2)


def test_a_candidate_flies_no_further_than_until_it_costs_too_much(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its first flight costs 3 or 1, each other one 1: what is worth 2.5 is known after one flight, or three."""
    flown: list[float] = []

    def fly(flight: Flight) -> float:
        k = gain_search.gains_of(flight.law)["k"] if flight.law else 0.0
        flown.append(k)
        return k if flight.off and flight.experiment is Experiment.CIRCLE else 1.0

    monkeypatch.setattr(gain_search, "fly", fly)
    laws = [ChosenLaw("law.py", (("k", k),)) for k in (3.0, 1.0)]
    tried = gain_search.judge(TASK, laws, Runner(Console(quiet=True), 1), worth=2.5)
    assert [(each.cost, each.flights) for each in tried] == [(math.inf, 1), (math.inf, 3)]
    assert flown == [3.0, 1.0, 1.0, 1.0]
    tried = gain_search.judge(TASK, laws, Runner(Console(quiet=True), 1))
    assert [(each.cost, each.flights) for each in tried] == [(6.0, 4), (4.0, 4)]


def test_what_is_better_by_itself_is_tried_together(tmp_path: Path) -> None:
    (tmp_path / "law.py").write_text(LAW)

    def tried(cost: float, k: float, d: float) -> Tried:
        return Tried(ChosenLaw(str(tmp_path / "law.py"), (("k", k), ("d", d))), cost, 1)

    base, better = tried(5.0, 1.0, 4.0), [tried(4.0, 2.0, 4.0), tried(4.5, 0.5, 4.0)]
    found = gain_search.together(base, [*better, tried(4.2, 1.0, 3.0), tried(9.0, 1.0, 4.5)])
    assert [gain_search.gains_of(law) for law in found] == [{"k": 2.0, "d": 3.0}]
    assert gain_search.together(base, better) == []
    assert gain_search.together(base, [*better, tried(4.2, 1.0, 6.0)]) == []  # which the law refuses


def test_no_law_is_tuned_where_it_is_judged() -> None:
    """Neither the leader's path nor where the wind comes from is one of the league's, nor is the seed."""
    paths, fans = set(), set()
    for scene in league.SCENES.values():
        scenario = scene(PAPER_40G)
        paths.add(scenario.lab.leader.trajectory.kind)
        fans |= {scenario.air.fan.pos_lab_m} if scenario.air.fan else set()
    for experiment, off in gain_search.EACH:
        scenario = tune.scenario_of(Flight(TASK, None, experiment, off, ChosenLaw("pid")))
        assert scenario.lab.leader.sysid is None or scenario.lab.leader.trajectory.kind not in paths
        assert scenario.air.fan is None or scenario.air.fan.pos_lab_m not in fans
    assert Row(ChosenLaw("default"), "line", "paper_40g").seed != tune.SEED


def test_the_gains_tried_are_those_that_fly() -> None:
    """Those of the lab's own preset fly the same flight, bit by bit, and others do not."""
    scenario = scenario_of(Job("pid", Experiment.GUST, 1)).model_copy(update={"longest_s": 8.0})
    own = preset_for("pid", PAPER_40G, scenario.lab.mocap)
    other = next(iter(gain_search.neighbours(own, 2.0)))
    assert isinstance(other, Preset)
    plain, tried, apart = (
        host.fly(scenario, 1, gains)[1].target["q_lab_from_flu"][:, 0].tolist() for gains in (None, own, other)
    )
    assert plain == tried != apart

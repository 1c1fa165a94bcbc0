import math
from pathlib import Path

import pytest
from rich.console import Console

from formation.control.gains import CascadeGains
from formation.control.presets import Preset, preset_for
from formation.vehicle.profile import PAPER_40G
from sim.studies import gain_search, host
from sim.studies.experiments import Experiment, Job, scenario_of
from sim.studies.gain_search import Tried, TriedLaw
from sim.studies.laws import ChosenLaw
from sim.studies.runner import Runner
from sim.studies.tune import Task

LAW = """
class Law:
    def __init__(self, k=1.0, d=4.0, off=0.0, n=3):
        if d > 4.7:
            raise ValueError("d is too large")

    def __call__(self, at):
        return [0.0, 0.0, 0.0]
"""
WANTED = (("k", 3.0), ("d", 5.0))
TASK = Task(PAPER_40G, rate_hz=100.0, delay_s=0.008, noise_m=0.0001)


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


def test_an_own_law_is_searched_by_its_options(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """A bowl whose floor lies at 3 and 5; what the law refuses is not tried."""
    (tmp_path / "law.py").write_text(LAW)

    def bowl(_task: Task, laws: list[ChosenLaw], _runner: Runner) -> list[TriedLaw]:
        return [TriedLaw(law, 1.0 + sum(math.log(dict(law.law)[k] / w) ** 2 for k, w in WANTED)) for law in laws]

    monkeypatch.setattr(gain_search, "judge_laws", bowl)
    law = ChosenLaw(str(tmp_path / "law.py"))
    assert law.options() == {"k": 1.0, "d": 4.0}
    best = gain_search.search_law(TASK, law, Runner(Console(quiet=True)), lambda _found: None)
    assert dict(best.law.law)["k"] == pytest.approx(3.0, rel=0.2)
    assert dict(best.law.law)["d"] == pytest.approx(4.5, rel=0.2)


def test_the_gains_tried_are_those_that_fly() -> None:
    """Those of the lab's own preset fly the same flight, bit by bit, and others do not."""
    scenario = scenario_of(Job("pid", Experiment.GUST, 1)).model_copy(update={"longest_s": 8.0})
    own = preset_for("pid", PAPER_40G, scenario.lab.mocap)
    other = next(gain_search.neighbours(own, 2.0))
    plain, tried, apart = (
        host.fly(scenario, 1, gains)[1].target["q_lab_from_flu"][:, 0].tolist() for gains in (None, own, other)
    )
    assert plain == tried != apart

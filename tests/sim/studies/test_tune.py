import math

import pytest
from rich.console import Console

from formation.control.margin import DelayMargin
from formation.control.presets import gain_scale_of, preset_for
from formation.vehicle.profile import PAPER_40G, PX4_QUAD, GainScale
from sim.studies import tune
from sim.studies.experiments import Experiment, Score
from sim.studies.gust import GustNumbers
from sim.studies.push import Settling
from sim.studies.runner import Runner
from sim.studies.tune import Candidate, Flight, Task

SLOW = Task(PX4_QUAD, rate_hz=50.0, delay_s=0.02, noise_m=0.0005)
MARGIN = DelayMargin("v", "default", loop_s=0.1, margin_s=0.05)


def a_score(outcome: str = "landed", dev: float = 0.04, chatter: float = 0.3, rms: float = 0.001) -> Score:
    gust, push = GustNumbers(0.5 * dev, dev, 0.2, 0.1, 0.05, chatter), Settling(outcome, 0.5, 1.0, 0.1)
    return Score(outcome, gust, push, rms, 0.001, None)


def test_a_flight_as_wanted_costs_one_for_each_thing_wanted() -> None:
    assert tune.cost_of(a_score(), Experiment.GUST) == pytest.approx(2.0)
    assert tune.cost_of(a_score(), Experiment.CIRCLE) == pytest.approx(1.0)
    assert tune.cost_of(a_score(), Experiment.PUSH) == pytest.approx(2.0)
    assert tune.cost_of(a_score(outcome="aborted"), Experiment.CIRCLE) == math.inf
    assert tune.cost_of(a_score(rms=math.nan), Experiment.CIRCLE) == math.inf


def test_neighbours_move_one_factor_by_one_step() -> None:
    found = list(tune.neighbours(GainScale(), 2.0))
    assert len(found) == 8
    for gain_scale in found:
        assert sorted(gain_scale.model_dump().values()) in ([0.5, 1.0, 1.0, 1.0], [1.0, 1.0, 1.0, 2.0])


def test_the_ground_believes_the_profile_and_the_other_vehicle_is_heavier_slower_and_later() -> None:
    gain_scale = GainScale(horizontal=0.7)
    nominal = tune.scenario_of(Flight(SLOW, gain_scale, Experiment.CIRCLE, off=False))
    off = tune.scenario_of(Flight(SLOW, gain_scale, Experiment.CIRCLE, off=True))
    assert nominal.lab == off.lab
    assert {nominal.lab.profile_of(v).gain_scale for v in nominal.lab.vehicles} == {gain_scale}
    assert (nominal.mocap.rate_hz, nominal.mocap.delay_s, nominal.mocap.noise_m) == (50.0, 0.02, 0.0005)
    assert nominal.lab.mocap.rate_hz == 50.0
    changed = off.true_vehicle(2).vehicle
    assert changed["mass_kg"] == pytest.approx(1.2)
    assert changed["command_delay_s"] == pytest.approx(1.5 * PX4_QUAD.command_delay_s)
    assert not nominal.true_vehicle(2).vehicle


def test_the_search_walks_downhill_and_stops_where_no_step_helps(monkeypatch: pytest.MonkeyPatch) -> None:
    """A bowl whose floor lies at 0.8, 1.2, 1.0, 1.0 stands in for the flights."""

    def bowl(_task: Task, scales: list[GainScale], _runner: Runner) -> list[Candidate]:
        def cost(p: GainScale) -> float:
            wanted = (0.8, 1.2, 1.0, 1.0)
            return 1.0 + sum(math.log(x / w) ** 2 for x, w in zip(p.model_dump().values(), wanted, strict=True))

        return [Candidate(gain_scale, cost(gain_scale), MARGIN) for gain_scale in scales]

    monkeypatch.setattr(tune, "judge", bowl)
    told: list[Candidate] = []
    task = Task(PAPER_40G.model_copy(update={"gain_scale": GainScale()}), 100.0, 0.008, 0.0001)
    first, best = tune.tune(task, Runner(Console(quiet=True)), told.append)
    assert first.gain_scale == GainScale()
    costs = [candidate.cost for candidate in told]
    assert costs == sorted(costs, reverse=True)
    assert best.cost < 1.02 < first.cost
    assert best.gain_scale.horizontal < 1.0 < best.gain_scale.observer


def test_a_tuned_pace_takes_the_place_of_the_rule() -> None:
    by_rule = gain_scale_of(PX4_QUAD, SLOW.mocap)
    assert by_rule.horizontal < 1.0
    tuned = PX4_QUAD.model_copy(update={"gain_scale": GainScale(horizontal=0.9, observer=0.6, compensation=1.1)})
    assert gain_scale_of(tuned, SLOW.mocap) == tuned.gain_scale
    shipped = preset_for("default", PAPER_40G.model_copy(update={"gain_scale": GainScale()}), SLOW.mocap)
    gains = preset_for("default", tuned, SLOW.mocap)
    assert gains.observer.bandwidth_rad_s == pytest.approx(0.6 * shipped.observer.bandwidth_rad_s)
    assert gains.dead_share == pytest.approx(1.1 * shipped.dead_share)
    assert preset_for("paper", tuned, SLOW.mocap) == preset_for("paper", PAPER_40G, SLOW.mocap)

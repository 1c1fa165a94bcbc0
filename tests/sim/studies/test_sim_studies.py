import io
import json
import threading
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from formation.vehicle.profile import PAPER_40G
from sim.scenario import agent_configs, recorded_leader
from sim.studies import experiments, paper, robustness
from sim.studies.experiments import CONTROLLERS, Experiment, Job, Score
from sim.studies.robustness import Draw, Sample
from sim.studies.runner import Runner, run_all


def double(number: int) -> int:
    if number == 7:
        raise ValueError("seven")
    return 2 * number


@pytest.mark.processes
def test_jobs_run_in_processes_give_results_in_order_and_tell_of_each() -> None:
    told: list[None] = []
    assert run_all(double, [3, 1, 2], lambda: told.append(None), workers=2) == [6, 2, 4]
    assert len(told) == 3


def threads(_job: int) -> int:
    return threading.active_count()


def test_a_job_that_is_alone_can_fork() -> None:
    """Beside a thread that draws a bar no flight of a campaign shares its beginning with another."""
    before = threading.active_count()
    assert Runner(Console(file=io.StringIO()), workers=1).run("threads", threads, [1, 2]) == [before, before]


def test_a_runner_writes_what_came_of_the_jobs_and_says_where(tmp_path: Path) -> None:
    console = Console(record=True, width=200, file=io.StringIO())
    runner = Runner(console, workers=1)
    results = runner.run("doubled", double, [3, 1, 2])
    runner.write(tmp_path / "new", {"a.txt": f"{results}", "b.txt": "b"})
    assert (tmp_path / "new" / "a.txt").read_text() == "[6, 2, 4]"
    assert f"{tmp_path / 'new' / 'a.txt'}  {tmp_path / 'new' / 'b.txt'}" in console.export_text()


@pytest.mark.parametrize("workers", [1, pytest.param(2, marks=pytest.mark.processes)])
def test_a_job_that_fails_fails_the_batch(workers: int) -> None:
    with pytest.raises(ValueError, match="seven"):
        run_all(double, [1, 7, 2], lambda: None, workers=workers)


def pulses(times_s: Sequence[float]) -> tuple[np.ndarray, np.ndarray]:
    """10 s at 100 Hz, and a push of 0.4 s at each of the times."""
    t_s = np.arange(0.0, 10.0, 0.01)
    push = np.zeros_like(t_s)
    for start_s in times_s:
        push[(t_s >= start_s) & (t_s < start_s + 0.4)] = 3.0
    return t_s, push


def test_settling_is_taken_pass_by_pass() -> None:
    """First pass: 5 cm at most, within 1 cm from 0.3 s after the push; second: 3 cm, never back before the third."""
    t_s, push = pulses((1.0, 3.0, 5.0))
    deviation = np.zeros_like(t_s)
    deviation[(t_s >= 1.1) & (t_s < 1.7)] = 0.05
    deviation[(t_s >= 3.1) & (t_s < 5.0)] = 0.03
    passes = experiments._passes(push)
    assert len(passes) == 3
    assert experiments._settling(t_s, deviation, passes) == pytest.approx((0.3 + 1.6 + 0.0) / 3, abs=0.02)


def test_nothing_pushed_gives_no_number() -> None:
    assert np.isnan(experiments._settling(np.arange(10.0), np.zeros(10), []))


def test_every_controller_flies_every_experiment_on_every_seed_under_its_own_preset() -> None:
    jobs = paper.jobs(range(1, 4))
    assert len(jobs) == 6 * 3 * 3
    assert len(set(jobs)) == len(jobs)
    assert {job.seed for job in jobs if job.traced} == {1}
    presets = {job.controller: experiments.scenario_of(job).lab.control_preset for job in jobs}
    assert presets == dict(CONTROLLERS)


def test_every_controller_sees_the_same_gust() -> None:
    fans = {experiments.scenario_of(Job(name, Experiment.GUST, 1)).air for name in CONTROLLERS}
    assert len(fans) == 1
    stronger = experiments.scenario_of(Job("cfc", Experiment.GUST, 1, gust_peak_m_s2=9.0)).air.fan
    assert stronger is not None
    assert stronger.peak_m_s2 == 9.0


def test_the_table_holds_medians_and_null_where_no_flight_could_tell(monkeypatch: pytest.MonkeyPatch) -> None:
    def scored(job: Job) -> Score:
        nan = float("nan")
        dev = 0.1 * job.seed if job.experiment is Experiment.GUST and job.controller != "smc" else nan
        return Score("landed", dev, dev, dev, dev, 0.001 * job.seed, 0.002, None)

    monkeypatch.setattr(paper, "fly", scored)
    runner = Runner(Console(quiet=True), workers=1)
    told = json.loads(paper.compare(paper.jobs((1, 2, 4)), runner).to_json())
    assert set(told) == {"controllers", "gust_peak_m_s2", "seeds"}
    assert set(told["controllers"]) == {"smc", "istsmc", "cfc_paper", "cfc", "pid", "geometric"}
    assert told["seeds"] == [1, 2, 4]
    cfc, smc = told["controllers"]["cfc"], told["controllers"]["smc"]
    assert cfc["gust_max_dev_m"] == pytest.approx(0.2)
    assert cfc["line_rms_m"] == pytest.approx(0.002)
    assert smc["gust_max_dev_m"] is None
    assert {
        "gust_max_dev_m", "gust_settle_s", "gust_z3_rms_error_m_s2", "line_vibration_m", "line_rms_m",
        "circle_vibration_m", "circle_rms_m", "chatter_deg",
    } <= set(cfc)  # fmt: skip


def test_a_draw_is_decided_by_its_seed() -> None:
    assert robustness.scenario_of(Draw(5)) == robustness.scenario_of(Draw(5))
    assert robustness.scenario_of(Draw(5)) != robustness.scenario_of(Draw(6))


def test_draws_cover_what_they_should_and_no_more() -> None:
    scenarios = [robustness.scenario_of(Draw(seed)) for seed in range(300)]
    true = [c.true_vehicle() for s in scenarios for c in agent_configs(s, recorded_leader(s))]
    mass = np.array([v.mass_kg for v in true]) / PAPER_40G.mass_kg
    lag = np.array([v.motor_lag_s for v in true]) / PAPER_40G.motor_lag_s
    slower = PAPER_40G.attitude_p_1_s / np.array([v.attitude_p_1_s for v in true])
    delay = np.array([s.mocap.delay_s for s in scenarios]) / 0.008
    for values, low, high in ((mass, 0.7, 1.3), (lag, 0.5, 1.5), (delay, 1.0, 2.0)):
        assert low <= values.min() < low + 0.03 * (high - low) + 0.02
        assert high - 0.03 * (high - low) - 0.02 < values.max() <= high
    assert np.allclose(lag, slower)
    assert {s.mocap.rate_hz for s in scenarios} == {50.0, 100.0, 240.0}
    assert all(s.mocap.rate_hz == s.lab.mocap.rate_hz for s in scenarios)
    assert all(0.0001 <= s.mocap.noise_m <= 0.001 for s in scenarios)
    assert all(gap.for_s == 0.05 and gap.body is None for s in scenarios for gap in s.mocap.gaps)
    flown = [next(e for e in Experiment if f"_{e}_" in s.name) for s in scenarios]
    assert all(70 < flown.count(e) < 130 for e in Experiment)


def test_the_controller_is_told_nothing_of_what_the_vehicle_truly_is() -> None:
    labs = {robustness.scenario_of(Draw(seed)).lab.leader.profile for seed in range(20)}
    assert labs == {"paper_40g"}
    slow = robustness.scenario_of(Draw(3, profile="px4_quad"))
    assert {v.profile for v in slow.lab.vehicles} == {"px4_quad"}


def a_sample(seed: int, rms_m: float, outcome: str = "landed", left_fence: bool = False) -> Sample:
    return Sample(Draw(seed), Experiment.LINE, outcome, rms_m, 2 * rms_m, left_fence)


def test_the_worst_are_the_failures_then_the_largest_errors() -> None:
    samples = [
        a_sample(1, 0.001), a_sample(2, 0.004), a_sample(3, 0.002, outcome="aborted"),
        a_sample(4, 0.001, left_fence=True), a_sample(5, float("nan")),
    ]  # fmt: skip
    order = [sample.draw.seed for sample in robustness.worst(samples, 4)]
    assert set(order[:3]) == {3, 4, 5}
    assert order[3] == 2
    assert [sample.failed for sample in samples] == [False, False, True, True, True]


def test_one_draw_flies_and_is_judged_the_same_again() -> None:
    drawn = ((seed, robustness.scenario_of(Draw(seed))) for seed in range(50))
    seed = next(seed for seed, scenario in drawn if "_line_" in scenario.name and scenario.mocap.rate_hz == 50.0)
    first, again = robustness.fly(Draw(seed)), robustness.fly(Draw(seed))
    assert first == again
    assert not first.failed
    assert first.rms_m < 0.01

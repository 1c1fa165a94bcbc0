import json

import pytest
from rich.console import Console

from sim.research import experiments, paper
from sim.research.experiments import CONTROLLERS, Experiment, Job, Score
from sim.research.gust import GustNumbers
from sim.research.mismatch import MISMATCHES
from sim.research.push import Settling
from sim.runner import Runner, run_all


def double(number: int) -> int:
    if number == 7:
        raise ValueError("seven")
    return 2 * number


@pytest.mark.processes
def test_jobs_run_in_processes_give_results_in_order_and_tell_of_each() -> None:
    told: list[None] = []
    assert run_all(double, [3, 1, 2], lambda: told.append(None), workers=2) == [6, 2, 4]
    assert len(told) == 3


@pytest.mark.parametrize("workers", [1, pytest.param(2, marks=pytest.mark.processes)])
def test_a_job_that_fails_fails_the_batch(workers: int) -> None:
    with pytest.raises(ValueError, match="seven"):
        run_all(double, [1, 7, 2], lambda: None, workers=workers)


def test_every_controller_flies_under_its_own_preset_and_nothing_twice() -> None:
    jobs = paper.jobs(range(1, 4))
    assert len(set(jobs)) == len(jobs)
    presets = {job.controller: experiments.scenario_of(job).lab.control_preset for job in jobs}
    assert presets == dict(CONTROLLERS)


def test_the_table_holds_medians_and_null_where_no_flight_could_tell(monkeypatch: pytest.MonkeyPatch) -> None:
    def scored(job: Job) -> Score:
        nan = float("nan")
        dev = 0.1 * job.seed if job.experiment is Experiment.GUST and job.controller != "smc" else nan
        off = 10.0 if job.mismatch == "weak motors" else 1.0
        gust = GustNumbers(0.5 * off * dev, off * dev, dev, dev, dev, dev)
        return Score("aborted" if job.mismatch else "landed", gust, Settling("landed"), 0.001 * job.seed, 0.002, None)

    monkeypatch.setattr(paper, "fly", scored)
    runner = Runner(Console(quiet=True), workers=1)
    told = json.loads(paper.compare(paper.jobs((1, 2, 4)), runner).to_json())
    assert set(told) == {"controllers", "mismatches", "vehicle", "gust_peak_m_s2", "seeds", "host"}
    assert list(told["controllers"]) == list(CONTROLLERS)
    assert told["vehicle"] == "paper_40g"
    assert told["seeds"] == [1, 2, 4]
    cfc, smc = told["controllers"]["cfc"], told["controllers"]["smc"]
    assert cfc["gust_max_dev_m"] == pytest.approx(0.2)
    assert cfc["gust_mean_dev_m"] == pytest.approx(0.1)
    assert cfc["aborted"] == 0
    assert list(told["mismatches"]) == list(MISMATCHES)
    assert told["mismatches"]["weak motors"]["gust_max_dev_m"] == pytest.approx(2.0)
    assert told["mismatches"]["half delay"] == {
        "gust_mean_dev_m": pytest.approx(0.1), "gust_max_dev_m": pytest.approx(0.2),
        "gust_settle_s": pytest.approx(0.2), "chatter_deg": pytest.approx(0.2), "aborted": 3,
    }  # fmt: skip
    assert cfc["line_rms_m"] == pytest.approx(0.002)
    assert smc["gust_max_dev_m"] is None
    assert {
        "gust_mean_dev_m", "gust_max_dev_m", "gust_settle_s", "gust_z3_share", "gust_z3_rms_error_m_s2",
        "line_vibration_m", "line_rms_m",
        "circle_vibration_m", "circle_rms_m", "chatter_deg",
    } <= set(cfc)  # fmt: skip

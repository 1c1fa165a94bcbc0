"""The calibration of the gust's fan, with flights that are made up."""

import io
from collections.abc import Callable

import pytest
from rich.console import Console

from bench import calibrate_fan
from formation.vehicle.profile import PAPER_40G
from sim.research import paper
from sim.research.experiments import Experiment, Job, Score
from sim.research.gust import GustNumbers
from sim.research.push import Settling
from sim.runner import Runner


def printed_in(deviation_m: Callable[[float], float]) -> Callable[[Job], Score]:
    """Flights in which the printed ISTSMC deviates so far in a fan of that peak, in the mean, and the largest twice."""

    def scored(job: Job) -> Score:
        assert (job.controller, job.experiment) == ("istsmc", Experiment.GUST)
        assert job.gust_peak_m_s2 is not None
        mean = deviation_m(job.gust_peak_m_s2) * (1.0 + 0.02 * (job.seed % 2))
        return Score("landed", GustNumbers(mean, 2.0 * mean), Settling("landed"), 0.0, 0.0, None)

    return scored


def test_the_fan_is_the_one_that_moves_the_printed_law_by_0_3_m_in_the_mean(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Runner, "run", lambda _self, _title, work, jobs: list(map(work, jobs)))
    monkeypatch.setattr(calibrate_fan, "fly", printed_in(lambda peak: 0.004 * peak**2))
    console = Console(file=io.StringIO(), record=True)
    peak = calibrate_fan.calibrate(PAPER_40G, console)
    assert 0.004 * peak**2 * 1.01 == pytest.approx(0.30, abs=0.006)
    assert f"peak {peak:.3f} m/s²" in console.export_text().splitlines()[-1]
    assert not set(calibrate_fan.SEEDS) & set(range(1, paper.SEEDS + 1))
    monkeypatch.setattr(calibrate_fan, "fly", printed_in(lambda _: 0.1))
    with pytest.raises(ValueError, match="no fan was found that moves paper_40g"):
        calibrate_fan.calibrate(PAPER_40G, console)

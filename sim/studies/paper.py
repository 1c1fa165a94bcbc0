"""`gcs-sim paper`: six controllers in the paper's three experiments, over ten seeds, beside the paper's own figures."""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from types import MappingProxyType

import numpy as np

from sim.scenario import load
from sim.studies.experiments import CONTROLLERS, SCENARIOS, Experiment, Job, Score, Trace, fly
from sim.studies.runner import Runner

SEEDS = 10
GUST_TARGET_M = 0.30
PEAKS_M_S2 = (3.5, 4.0, 4.5, 5.0, 5.5, 6.0)

REPORTED: Mapping[str, Mapping[str, float]] = MappingProxyType(
    {
        "smc": {"line_vibration_m": 0.07, "circle_vibration_m": 0.06},
        "istsmc": {"gust_max_dev_m": 0.3},
        "cfc_paper": {"gust_max_dev_m": 0.08, "line_vibration_m": 0.02, "circle_vibration_m": 0.025},
    }
)
"""What the paper reports of its hardware flights (Figures 5 to 7)."""


@dataclass(frozen=True, slots=True)
class Figures:
    """One controller in numbers, each the median over the seeds; None where no flight of it could tell."""

    gust_max_dev_m: float | None
    gust_settle_s: float | None
    gust_z3_rms_error_m_s2: float | None
    line_vibration_m: float | None
    line_rms_m: float | None
    circle_vibration_m: float | None
    circle_rms_m: float | None
    chatter_deg: float | None
    aborted: int = 0


@dataclass(frozen=True, slots=True)
class Comparison:
    """The whole study: the table, the gust all were given, and what the figures show of each controller."""

    controllers: Mapping[str, Figures]
    gust_peak_m_s2: float
    seeds: tuple[int, ...]
    traces: Mapping[tuple[str, Experiment], Trace]

    def to_json(self) -> str:
        """paper.json."""
        return json.dumps(
            {
                "controllers": {name: asdict(figures) for name, figures in self.controllers.items()},
                "gust_peak_m_s2": self.gust_peak_m_s2,
                "seeds": list(self.seeds),
            },
            indent=2,
            allow_nan=False,
        )


def jobs(seeds: Sequence[int]) -> list[Job]:
    """Every flight of the study; the first seed's are traced for the figures."""
    return [
        Job(controller, experiment, seed, traced=seed == seeds[0])
        for controller in CONTROLLERS
        for experiment in Experiment
        for seed in seeds
    ]


def compare(flights: Sequence[Job], runner: Runner) -> Comparison:
    """Fly them all and put the numbers together."""
    scores = dict(zip(flights, runner.run("flights", fly, flights), strict=True))
    seeds = tuple(sorted({job.seed for job in flights}))
    traces = {(job.controller, job.experiment): s.trace for job, s in scores.items() if s.trace is not None}
    return Comparison({name: _figures(name, scores) for name in CONTROLLERS}, gust_peak_m_s2(), seeds, traces)


def gust_peak_m_s2() -> float:
    """The strength of the shipped scenario's fan."""
    fan = load(SCENARIOS[Experiment.GUST]).air.fan
    return 0.0 if fan is None else fan.peak_m_s2


def calibrate(runner: Runner, flown: Callable[[float, float], None]) -> float:
    """The fan's peak push (m/s^2) under which the printed ISTSMC alone deviates by 0.30 m: what the scenario holds.

    A line through the medians over the seeds, which scatter: the printed gains swing by themselves. `flown` is told
    each peak flown and the deviation it gave.
    """
    deviations = []
    for peak in PEAKS_M_S2:
        flights = [Job("istsmc", Experiment.GUST, seed + 1, gust_peak_m_s2=peak) for seed in range(SEEDS)]
        deviations.append(float(np.median([score.max_dev_m for score in runner.run(f"{peak:g} m/s²", fly, flights)])))
        flown(peak, deviations[-1])
    slope, at_zero = np.polyfit(PEAKS_M_S2, deviations, 1)
    return float((GUST_TARGET_M - at_zero) / slope)


def _figures(controller: str, scores: Mapping[Job, Score]) -> Figures:
    """The medians of one controller's flights."""

    def median(experiment: Experiment, field: Callable[[Score], float]) -> float | None:
        values = [field(s) for job, s in scores.items() if (job.controller, job.experiment) == (controller, experiment)]
        known = [value for value in values if np.isfinite(value)]
        return float(np.median(known)) if known else None

    return Figures(
        gust_max_dev_m=median(Experiment.GUST, lambda s: s.max_dev_m),
        gust_settle_s=median(Experiment.GUST, lambda s: s.settle_s),
        gust_z3_rms_error_m_s2=median(Experiment.GUST, lambda s: s.z3_error_m_s2),
        line_vibration_m=median(Experiment.LINE, lambda s: s.vibration_m),
        line_rms_m=median(Experiment.LINE, lambda s: s.rms_m),
        circle_vibration_m=median(Experiment.CIRCLE, lambda s: s.vibration_m),
        circle_rms_m=median(Experiment.CIRCLE, lambda s: s.rms_m),
        chatter_deg=median(Experiment.GUST, lambda s: s.chatter_deg),
        aborted=sum(s.outcome == "aborted" for job, s in scores.items() if job.controller == controller),
    )

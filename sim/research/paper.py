"""`gcs-sim paper`: the paper's three experiments under seven controllers, beside its own figures.

And the gust on five vehicles that the controller does not know (sim.research.mismatch).
"""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from types import MappingProxyType

import numpy as np

from formation.vehicle.profile import PAPER_40G, VehicleProfile
from sim.research.experiments import CONTROLLERS, Experiment, Job, Score, Trace, fly, gust_peak_m_s2
from sim.research.host import Host
from sim.research.mismatch import MISMATCHES
from sim.runner import Runner

SEEDS = 10
SHIPPED = "cfc"
SHOWN = (Experiment.GUST, Experiment.LINE, Experiment.CIRCLE)
"""Figures 5, 6 and 7."""

REPORTED: Mapping[str, Mapping[str, float]] = MappingProxyType(
    {
        "smc": {"line_vibration_m": 0.07, "circle_vibration_m": 0.06},
        "istsmc": {"gust_mean_dev_m": 0.3},
        "cfc_paper": {"gust_mean_dev_m": 0.08, "line_vibration_m": 0.02, "circle_vibration_m": 0.025},
    }
)
"""What the paper reports of its hardware flights (Figures 5 to 7)."""


@dataclass(frozen=True, slots=True)
class Figures:
    """One controller in numbers, each the median over the seeds; None where no flight of it has the number.

    gust_mean_dev_m is the paper's "average maximum deviation" (sim.research.gust).
    """

    gust_mean_dev_m: float | None
    gust_max_dev_m: float | None
    gust_settle_s: float | None
    gust_z3_rms_error_m_s2: float | None
    gust_z3_share: float | None
    line_vibration_m: float | None
    line_rms_m: float | None
    circle_vibration_m: float | None
    circle_rms_m: float | None
    chatter_deg: float | None
    aborted: int = 0


@dataclass(frozen=True, slots=True)
class Mismatched:
    """The shipped controller in the gust, on a vehicle that it does not know; medians as in `Figures`."""

    gust_mean_dev_m: float | None
    gust_max_dev_m: float | None
    gust_settle_s: float | None
    chatter_deg: float | None
    aborted: int = 0


@dataclass(frozen=True, slots=True)
class Comparison:
    """The whole study: the table, the gust all were given, and what the figures show of each controller."""

    controllers: Mapping[str, Figures]
    mismatches: Mapping[str, Mismatched]
    vehicle: str
    gust_peak_m_s2: float
    seeds: tuple[int, ...]
    host: Host
    traces: Mapping[tuple[str, Experiment], Trace]

    def to_json(self) -> str:
        """paper.json."""
        return json.dumps(
            {
                "controllers": {name: asdict(figures) for name, figures in self.controllers.items()},
                "mismatches": {name: asdict(figures) for name, figures in self.mismatches.items()},
                "vehicle": self.vehicle,
                "gust_peak_m_s2": self.gust_peak_m_s2,
                "seeds": list(self.seeds),
                "host": self.host,
            },
            indent=2,
            allow_nan=False,
        )


def jobs(
    seeds: Sequence[int],
    vehicle: VehicleProfile = PAPER_40G,
    controllers: Sequence[str] = tuple(CONTROLLERS),
    host: Host = Host.STUDY,
) -> list[Job]:
    """Every flight of the study; the first seed's are traced for the figures.

    ValueError names the known controllers.
    """
    if unknown := set(controllers) - set(CONTROLLERS):
        raise ValueError(f"unknown controller {min(unknown)!r}; known: {', '.join(CONTROLLERS)}")
    flights = [
        Job(controller, experiment, seed, seed == seeds[0], vehicle, host=host)
        for controller in controllers
        for experiment in SHOWN
        for seed in seeds
    ]
    if SHIPPED in controllers:
        flights += [
            Job(SHIPPED, Experiment.GUST, s, vehicle=vehicle, mismatch=name, host=host)
            for name in MISMATCHES
            for s in seeds
        ]
    return flights


def compare(flights: Sequence[Job], runner: Runner) -> Comparison:
    """Fly them all and put the numbers together; they are all of one vehicle, by one host."""
    flown = list(zip(flights, runner.run("flights", fly, flights), strict=True))
    vehicle, seeds = flights[0].vehicle, tuple(sorted({job.seed for job in flights}))
    known = [(job, score) for job, score in flown if job.mismatch is None]
    return Comparison(
        {
            name: _figures(own)
            for name in CONTROLLERS
            if (own := [pair for pair in known if pair[0].controller == name])
        },
        {name: _mismatched([s for job, s in flown if job.mismatch == name]) for name in MISMATCHES}
        if len(known) < len(flown)
        else {},
        vehicle.name,
        gust_peak_m_s2(vehicle),
        seeds,
        flights[0].host,
        {(job.controller, job.experiment): score.trace for job, score in known if score.trace is not None},
    )


def _median(scores: Sequence[Score], field: Callable[[Score], float]) -> float | None:
    known = [value for value in map(field, scores) if np.isfinite(value)]
    return float(np.median(known)) if known else None


def _figures(flown: Sequence[tuple[Job, Score]]) -> Figures:
    """The medians of one controller's flights."""
    gust, line, circle = ([score for job, score in flown if job.experiment is e] for e in SHOWN)
    return Figures(
        gust_mean_dev_m=_median(gust, lambda s: s.gust.mean_dev_m),
        gust_max_dev_m=_median(gust, lambda s: s.gust.max_dev_m),
        gust_settle_s=_median(gust, lambda s: s.gust.settle_s),
        gust_z3_rms_error_m_s2=_median(gust, lambda s: s.gust.z3_error_m_s2),
        gust_z3_share=_median(gust, lambda s: s.gust.z3_share),
        line_vibration_m=_median(line, lambda s: s.vibration_m),
        line_rms_m=_median(line, lambda s: s.rms_m),
        circle_vibration_m=_median(circle, lambda s: s.vibration_m),
        circle_rms_m=_median(circle, lambda s: s.rms_m),
        chatter_deg=_median(gust, lambda s: s.gust.chatter_deg),
        aborted=_aborted([score for _, score in flown]),
    )


def _mismatched(scores: Sequence[Score]) -> Mismatched:
    """The medians of one mismatch's flights."""
    return Mismatched(
        _median(scores, lambda s: s.gust.mean_dev_m),
        _median(scores, lambda s: s.gust.max_dev_m),
        _median(scores, lambda s: s.gust.settle_s),
        _median(scores, lambda s: s.gust.chatter_deg),
        _aborted(scores),
    )


def _aborted(scores: Sequence[Score]) -> int:
    return sum(score.outcome in ("aborted", "lost", "cut") for score in scores)

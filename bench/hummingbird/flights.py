"""The paper's line, circle and gust, flown by the whole stack on rotorpy's physics.

Cameras, links and delays are the scenarios' (sim.research.experiments), every monitor is on. The fan is a wind of 5 m/s
in its core, of which rotorpy's aerodynamics make the push.
"""

import json
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from analysis.load import load
from bench.hummingbird.vehicle import HUMMINGBIRD, push_m_s2, rotorpy_physics
from sim import lockstep
from sim.research.experiments import Experiment, Job, Score, measure, scenario_of
from sim.scenario import Scenario

WIND_M_S = 5.0
CONTROLLER = "cfc"
EXPERIMENTS = (Experiment.GUST, Experiment.LINE, Experiment.CIRCLE)


@dataclass(frozen=True, slots=True)
class Flight:
    """Which experiment, with which luck, and the folder that its log is written to."""

    experiment: Experiment
    seed: int
    folder: Path


@dataclass(frozen=True, slots=True)
class Assumed:
    """What lies between exposure and thrust, s: cameras, link, and the vehicle as the ground believes it."""

    mocap_delay_s: float
    link_s: float
    response_dead_time_s: float
    response_lag_s: float
    thrust_dead_time_s: float
    thrust_lag_s: float


@dataclass(frozen=True, slots=True)
class Benchmark:
    """Medians over the seeds, as sim.research.experiments measures them; None where a flight has no number."""

    vehicle: str
    seeds: int
    landed: int
    flights: int
    line_rms_m: float | None
    circle_rms_m: float | None
    line_vibration_m: float | None
    circle_vibration_m: float | None
    wind_m_s: float
    gust_mean_dev_m: float | None
    gust_max_dev_m: float | None
    gust_settle_s: float | None
    chatter_deg: float | None
    assumed: Assumed

    def to_json(self) -> str:
        """Indented JSON of every key."""
        return json.dumps(asdict(self), indent=2, allow_nan=False)


def flights(seeds: range, folder: Path) -> list[Flight]:
    """Every experiment with every seed."""
    return [Flight(experiment, seed, folder) for experiment in EXPERIMENTS for seed in seeds]


def benchmark(flown: list[Flight], scores: list[Score]) -> Benchmark:
    """The numbers of all flights, in their order."""

    def median(experiment: Experiment, of: str) -> float | None:
        values = [
            _number(score, of) for flight, score in zip(flown, scores, strict=True) if flight.experiment == experiment
        ]
        value = float(np.median(values))
        return value if np.isfinite(value) else None

    return Benchmark(
        vehicle=HUMMINGBIRD.name,
        seeds=len({flight.seed for flight in flown}),
        landed=sum(score.outcome == "landed" for score in scores),
        flights=len(scores),
        line_rms_m=median(Experiment.LINE, "rms_m"),
        circle_rms_m=median(Experiment.CIRCLE, "rms_m"),
        line_vibration_m=median(Experiment.LINE, "vibration_m"),
        circle_vibration_m=median(Experiment.CIRCLE, "vibration_m"),
        wind_m_s=WIND_M_S,
        gust_mean_dev_m=median(Experiment.GUST, "mean_dev_m"),
        gust_max_dev_m=median(Experiment.GUST, "max_dev_m"),
        gust_settle_s=median(Experiment.GUST, "settle_s"),
        chatter_deg=median(Experiment.GUST, "chatter_deg"),
        assumed=assumed(),
    )


def fly(flight: Flight) -> Score:
    """Fly, keep the log, and measure it."""
    scenario = scenario_for(flight.experiment)
    path = flight.folder / f"{flight.experiment}-{flight.seed}.mcap"
    flown = lockstep.run_to_file(scenario, flight.seed, path, physics=rotorpy_physics())
    return measure(load(path), scenario, flown.outcome.result, flight.experiment)


def scenario_for(experiment: Experiment) -> Scenario:
    """The shipped scenario with Hummingbirds, and wind from the fan."""
    return scenario_of(Job(CONTROLLER, experiment, 1, vehicle=HUMMINGBIRD, gust_peak_m_s2=push_m_s2(WIND_M_S)))


def assumed() -> Assumed:
    """The same in every experiment."""
    scenario = scenario_for(Experiment.LINE)
    return Assumed(
        scenario.mocap.delay_s,
        scenario.link.down_s,
        HUMMINGBIRD.response_dead_time_s,
        HUMMINGBIRD.response_lag_s,
        HUMMINGBIRD.thrust_dead_time_s,
        HUMMINGBIRD.thrust_lag_s,
    )


def _number(score: Score, name: str) -> float:
    return float(getattr(score if hasattr(score, name) else score.gust, name))

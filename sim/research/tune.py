"""`gcs-sim tune`: the gain scales of a vehicle's loops, found by flying.

The rule that every vehicle is given without asking (formation.control.presets) slows the shipped gains down in
proportion to the loop's delay. From there a compass search (Kolda, Lewis, Torczon, SIAM Review 2003) moves four
factors, each by a step up or down: of the horizontal gains (c, p1 with it, p2 with its square), of the horizontal
observer's bandwidth, of the vertical gains and observer, and of the dead time and lag that are compensated. Each
candidate flies gust, circle and the hardest steady push with the vehicle as its profile says and with one that is
heavier, slower and later. It is judged by deviation, formation error, chatter, and how it settles in the push, each in
units of what is wanted. A candidate that the loop's delay margin does not carry is not flown.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Protocol, TypeVar

import numpy as np

from drone_agent.simulation.disturbance import Disturbance
from formation.codes import GOOD_RESULTS
from formation.config import MocapConfig
from formation.control.margin import DelayMargin, delay_margin
from formation.control.presets import Preset, gain_scale_of, preset_for
from formation.trajectory_config import TrajectoryConfig
from formation.vehicle.profile import GainScale, VehicleProfile
from sim.research import experiments, host
from sim.research.experiments import Experiment, Job, Score
from sim.research.host import Host
from sim.research.laws import ChosenLaw
from sim.runner import Runner
from sim.scenario import Scenario, TrueVehicle, flown_by

STEPS = (1.3, 1.15, 1.07)
ROUNDS_EACH = 6
PRESET = "default"
EXPERIMENTS = (Experiment.GUST, Experiment.CIRCLE, Experiment.PUSH)
SEED = 101  # none of those that `gcs-sim paper` shows
FORMATION_S = 12.0
WANTED_DEVIATION_M, WANTED_RMS_M, WANTED_CHATTER_DEG = 0.04, 0.001, 0.3
WANTED_SETTLE_S, WANTED_SWING_DEG = 1.0, 0.5  # in the hardest steady push (sim.research.push)
HEAVIER, SLOWER, LATER = 1.2, 1.3, 1.5
BETTER = 0.99
"""A candidate must cost less than this share of the best to take its place."""
PRACTICE_PATH = TrajectoryConfig(
    kind="lissajous", amplitude_m=(0.5, 0.4, 0.1), cycles=(3, 2, 1), phase_rad=(0.0, 0.0, 0.0), period_s=FORMATION_S
)
FACTORS = ("horizontal", "observer", "vertical", "compensation")


@dataclass(frozen=True, slots=True)
class Task:
    """What is tuned for: a vehicle, and the cameras' rate and delay; host: what flies it."""

    profile: VehicleProfile
    rate_hz: float
    delay_s: float
    host: Host = Host.STUDY

    @property
    def mocap(self) -> MocapConfig:
        """The mocap configuration that the ground has."""
        return MocapConfig(rate_hz=self.rate_hz, delay_s=self.delay_s)


@dataclass(frozen=True, slots=True)
class Flight:
    """One flight of one candidate; off: by a vehicle that is not as believed; law: instead of the default preset, and
    elsewhere than where laws are judged; an own law by the host of studies."""

    task: Task
    gain_scale: GainScale | None
    experiment: Experiment
    off: bool
    law: Preset | ChosenLaw | None = None


@dataclass(frozen=True, slots=True)
class Candidate:
    """Gain scales and what it costs: infinite where it does not fly."""

    gain_scale: GainScale
    cost: float
    margin: DelayMargin


def tune(task: Task, runner: Runner, better: Callable[[Candidate], None]) -> tuple[Candidate, Candidate]:
    """The rule's candidate and the best one found; `better` is called with each better one."""
    first = judge(task, [gain_scale_of(task.profile, task.mocap)], runner)[0]

    def neighbours_of(candidate: Candidate, step: float) -> list[Candidate]:
        return judge(task, list(neighbours(candidate.gain_scale, step)), runner)

    return first, compass(first, neighbours_of, better)


class Costed(Protocol):
    """What a search compares."""

    @property
    def cost(self) -> float:
        """Less is better."""


Tried = TypeVar("Tried", bound=Costed)


def compass(
    first: Tried,
    neighbours_of: Callable[[Tried, float], list[Tried]],
    better: Callable[[Tried], None],
    steps: Sequence[float] = STEPS,
) -> Tried:
    """The best found from `first` on by compass search with decreasing steps; `better` is called with each better one.

    neighbours_of: the candidates one step away from one.
    """
    best = first
    better(best)
    for step in steps:
        for _ in range(ROUNDS_EACH):
            found = min(neighbours_of(best, step), key=lambda candidate: candidate.cost, default=best)
            if found.cost >= BETTER * best.cost:
                break
            best = found
            better(best)
    return best


def neighbours(gain_scale: GainScale, step: float) -> Iterator[GainScale]:
    """The eight candidates one step away."""
    for factor, by in product(FACTORS, (step, 1.0 / step)):
        yield gain_scale.model_copy(update={factor: by * getattr(gain_scale, factor)})


def judge(task: Task, scales: list[GainScale], runner: Runner) -> list[Candidate]:
    """Fly and cost each."""
    margins = runner.run("delay margins", _margin, [(task, gain_scale) for gain_scale in scales])
    flights = [
        Flight(task, gain_scale, experiment, off)
        for gain_scale, margin in zip(scales, margins, strict=True)
        if margin.carried
        for experiment, off in product(EXPERIMENTS, (False, True))
    ]
    costs = dict(zip(flights, runner.run("flights", fly, flights), strict=True))
    return [
        Candidate(
            gain_scale,
            sum(costs[f] for f in flights if f.gain_scale == gain_scale) if margin.carried else float("inf"),
            margin,
        )
        for gain_scale, margin in zip(scales, margins, strict=True)
    ]


def fly(flight: Flight) -> float:
    """The cost of one flight."""
    scenario = scenario_of(flight)
    law = flight.law
    own = law.own(scenario.lab) if isinstance(law, ChosenLaw) else None
    result, log = host.fly(scenario, SEED, law if isinstance(law, Preset) else None, flight.task.host, own)
    if len(log.law_failures):
        return float("inf")
    return cost_of(experiments.measure(log, scenario, result, flight.experiment), flight.experiment)


def cost_of(score: Score, experiment: Experiment) -> float:
    """What a flight costs, in units of what is wanted; infinite where it did not end well."""
    match experiment:
        case Experiment.GUST:
            parts = [score.gust.max_dev_m / WANTED_DEVIATION_M, score.gust.chatter_deg / WANTED_CHATTER_DEG]
        case Experiment.PUSH:
            parts = [score.push.settle_s / WANTED_SETTLE_S, score.push.swing_deg / WANTED_SWING_DEG]
        case _:
            parts = [score.rms_m / WANTED_RMS_M]
    total = sum(parts)
    return total if score.outcome in GOOD_RESULTS and np.isfinite(total) else float("inf")


def scenario_of(flight: Flight) -> Scenario:
    """The experiment cut short, flown by the tuned vehicle under the cameras of the task."""
    task = flight.task
    believed = task.profile.model_copy(update={"gain_scale": flight.gain_scale})
    scenario = experiments.scenario_of(Job("cfc", flight.experiment, seed=SEED, vehicle=believed))
    if flight.law is not None:
        scenario = practice(scenario, flight.experiment)
    lab = flown_by(scenario.lab, believed, PRESET).model_copy(update={"mocap": task.mocap})
    mocap = scenario.mocap.model_copy(update={"rate_hz": task.rate_hz, "delay_s": task.delay_s})
    update: dict[str, object] = {"lab": lab, "mocap": mocap}
    if flight.experiment is not Experiment.PUSH:
        update["formation_s"] = FORMATION_S
    if flight.off:
        off = {
            "mass_kg": HEAVIER * believed.mass_kg,
            "motor_lag_s": SLOWER * believed.motor_lag_s,
            "attitude_p_1_s": believed.attitude_p_1_s / SLOWER,
            "command_delay_s": LATER * believed.command_delay_s,
        }
        update["vehicles"] = tuple(
            TrueVehicle(sysid=v.sysid, start=scenario.true_vehicle(v.sysid).start, vehicle=dict(off))
            for v in lab.vehicles
            if v.sysid is not None
        )
    return scenario.model_copy(update=update)


def practice(scenario: Scenario, experiment: Experiment) -> Scenario:
    """The like of an experiment, in which no law is judged: another path for the leader, the wind from elsewhere."""
    fan = scenario.air.fan
    if fan is None:
        lab = scenario.lab
        leader = lab.leader.model_copy(update={"trajectory": PRACTICE_PATH})
        return scenario.model_copy(update={"lab": lab.model_copy(update={"leader": leader}), "vehicles": ()})
    x, y, z = fan.pos_lab_m
    other: dict[str, object] = {"pos_lab_m": (y, x, z), "heading_rad": -0.5 * np.pi}
    if experiment is Experiment.GUST:
        other = {"pos_lab_m": (-x, y, z), "heading_rad": 0.0, "period_s": 3.0, "phase_s": 1.25}
    return scenario.model_copy(update={"air": Disturbance(fan=fan.model_copy(update=other))})


def _margin(job: tuple[Task, GainScale]) -> DelayMargin:
    task, gain_scale = job
    profile = task.profile.model_copy(update={"gain_scale": gain_scale})
    return delay_margin(profile, preset_for(PRESET, profile, task.mocap), task.mocap)

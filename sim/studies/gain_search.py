"""`gcs-sim tune PROFILE --gains PRESET`, or `--law FILE.py`: the gains of a law, each by itself, found by flying.

The same compass search, costs and effort whatever the law, so that laws can be compared each with the gains that it
flies best with. It flies where no law is judged (sim.studies.tune.practice). A candidate that costs too much already
flies no further.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import numpy as np

from formation.control.gains import CascadeGains, Gains, GeometricGains, SlidingGains
from formation.control.presets import Preset, preset_for
from sim.studies.experiments import Experiment
from sim.studies.laws import ChosenLaw
from sim.studies.runner import Runner
from sim.studies.tune import BETTER, Flight, Task, compass, fly

SEARCHED: dict[type[Gains], tuple[str, ...]] = {
    SlidingGains: ("c", "p1", "p2", "smooth_m_s"),
    CascadeGains: ("kp_position", "kp", "ki"),
    GeometricGains: ("kx", "kv", "ki", "mix"),
}
"""The gains that are moved; the observer's bandwidth is one more."""
EACH = ((Experiment.CIRCLE, True), (Experiment.CIRCLE, False), (Experiment.GUST, False), (Experiment.PUSH, True))
"""What each candidate flies: an experiment, and whether with a vehicle that is not as believed."""
LAW_FLIGHTS = 120
"""With so many flights or more behind it, the search for an own law's options begins no new round."""
LAW_STEPS = (1.6, 1.25, 1.1)


@dataclass(frozen=True, slots=True)
class TriedLaw:
    """An own law with its options, what it costs, infinite where it was given up, and how many flights that took."""

    law: ChosenLaw
    cost: float
    flights: int


@dataclass(frozen=True, slots=True)
class Tried:
    """Gains, and what they cost."""

    gains: Preset
    cost: float


def search(task: Task, name: str, runner: Runner, better: Callable[[Tried], None]) -> Tried:
    """The best gains found from that preset's own on; ValueError if there is no such preset."""
    first = judge(task, [preset_for(name, task.profile, task.mocap)], runner)[0]

    def neighbours_of(tried: Tried, step: float) -> list[Tried]:
        return judge(task, list(neighbours(tried.gains, step)), runner, BETTER * tried.cost)

    return compass(first, neighbours_of, better)


def neighbours(gains: Preset, step: float) -> Iterator[Preset]:
    """The presets with one gain of the followers, or their observer's bandwidth, a step up or down."""
    follower = gains.follower
    for field, by in product(SEARCHED[type(follower)], (step, 1.0 / step)):
        yield replace(gains, follower=replace(follower, **{field: by * getattr(follower, field)}))
    for by in (step, 1.0 / step):
        yield replace(gains, observer=gains.observer.scaled(by))


def search_law(task: Task, law: ChosenLaw, runner: Runner, better: Callable[[TriedLaw], None]) -> TriedLaw:
    """The best options found from an own law's own on; ValueError where there is no such law."""
    first = judge_laws(task, [replace(law, law=tuple(law.options().items()))], runner)[0]
    flown = first.flights

    def neighbours_of(tried: TriedLaw, step: float) -> list[TriedLaw]:
        nonlocal flown
        if flown >= LAW_FLIGHTS:
            return []
        found = judge_laws(task, list(neighbouring_laws(tried.law, step)), runner, BETTER * tried.cost)
        found += judge_laws(task, together(tried, found), runner, min((each.cost for each in found), default=0.0))
        flown += sum(each.flights for each in found)
        return found

    return compass(first, neighbours_of, better, LAW_STEPS)


def together(tried: TriedLaw, neighbours: Sequence[TriedLaw]) -> list[ChosenLaw]:
    """The law with every option as the best of its better neighbours has it, where several options are better so."""
    options = dict(tried.law.law)
    better = sorted((each for each in neighbours if each.cost < tried.cost), key=lambda each: -each.cost)
    changed = {key: value for each in better for key, value in each.law.law if value != options[key]}
    return list(_makeable([replace(tried.law, law=tuple((options | changed).items()))])) if len(changed) > 1 else []


def neighbouring_laws(law: ChosenLaw, step: float) -> Iterator[ChosenLaw]:
    """The laws with one option a step up or down, as far as they can be made so."""
    options = dict(law.law)
    return _makeable(
        [replace(law, law=tuple((options | {key: by * options[key]}).items()))
         for key, by in product(options, (step, 1.0 / step))]
    )  # fmt: skip


def _makeable(laws: Sequence[ChosenLaw]) -> Iterator[ChosenLaw]:
    for law in laws:
        with suppress(ValueError):
            law.maker()
            yield law


def judge_laws(task: Task, laws: list[ChosenLaw], runner: Runner, worth: float = np.inf) -> list[TriedLaw]:
    """Fly and cost each, none further than until it costs `worth`."""
    costs, flown = _costs(task, [{"law": law} for law in laws], runner, worth)
    return [TriedLaw(*each) for each in zip(laws, costs, flown, strict=True)]


def judge(task: Task, presets: list[Preset], runner: Runner, worth: float = np.inf) -> list[Tried]:
    """Fly and cost each, none further than until it costs `worth`."""
    costs, _ = _costs(task, [{"gains": gains} for gains in presets], runner, worth)
    return [Tried(gains, cost) for gains, cost in zip(presets, costs, strict=True)]


def _costs(
    task: Task, flown_with: Sequence[Mapping[str, Any]], runner: Runner, worth: float
) -> tuple[list[float], list[int]]:
    """Fly the next of EACH with all that do not cost `worth` yet; what each costs, infinite if so much, and flights."""
    costs, flown = np.zeros(len(flown_with)), np.zeros(len(flown_with), np.int64)
    for experiment, off in EACH:
        left = np.flatnonzero(costs < worth).tolist()
        flights = [Flight(task, task.profile.gain_scale, experiment, off, practice=True, **flown_with[k]) for k in left]
        costs[left] += runner.run("flights", fly, flights)
        flown[left] += 1
    return np.where(costs < worth, costs, np.inf).tolist(), flown.tolist()

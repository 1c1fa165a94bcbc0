"""`gcs-sim tune PROFILE --law LAW`: the gains of a law, each by itself, found by flying.

The same compass search, costs and effort whatever the law, so that laws can be compared each with the gains that it
flies best with. It flies where no law is judged (sim.research.tune.practice). A candidate that costs too much already
flies no further.
"""

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import numpy as np

from formation.control.gains import CascadeGains, Gains, GeometricGains, SlidingGains
from formation.control.presets import Preset, preset_for
from sim.research.experiments import Experiment
from sim.research.laws import ChosenLaw
from sim.research.tune import BETTER, Flight, Task, compass, fly
from sim.runner import Runner

SEARCHED: dict[type[Gains], tuple[str, ...]] = {
    SlidingGains: ("c", "p1", "p2", "smooth_m_s"),
    CascadeGains: ("kp_position", "kp", "ki"),
    GeometricGains: ("kx", "kv", "ki", "mix"),
}
"""The gains that are moved; the observer's bandwidth is one more."""
EACH = ((Experiment.CIRCLE, True), (Experiment.CIRCLE, False), (Experiment.GUST, False), (Experiment.PUSH, True))
"""What each candidate flies: an experiment, and whether with a vehicle that is not as believed."""
FLIGHTS = 120
"""With so many flights or more behind it, a search begins no new round, whatever the law."""
STEPS = (1.6, 1.25, 1.1)
Searched = Preset | ChosenLaw
"""A built-in law's gains, or an own law with its options."""


@dataclass(frozen=True, slots=True)
class Tried:
    """A law, what it costs, infinite where it was given up, and how many flights that took."""

    law: Searched
    cost: float
    flights: int


def search(task: Task, law: ChosenLaw, runner: Runner, better: Callable[[Tried], None]) -> Tried:
    """The best gains or options found from the law's own on; ValueError where there is no such law."""
    own: Searched = (
        preset_for(law.name, task.profile, task.mocap)
        if law.is_preset
        else replace(law, law=tuple(law.options().items()))
    )
    first = judge(task, [own], runner)[0]
    flown = first.flights

    def neighbours_of(tried: Tried, step: float) -> list[Tried]:
        nonlocal flown
        if flown >= FLIGHTS:
            return []
        found = judge(task, list(neighbours(tried.law, step)), runner, BETTER * tried.cost)
        found += judge(task, together(tried, found), runner, min((each.cost for each in found), default=0.0))
        flown += sum(each.flights for each in found)
        return found

    return compass(first, neighbours_of, better, STEPS)


def neighbours(law: Searched, step: float) -> Iterator[Searched]:
    """The laws with one of their gains or options, or a preset's observer's bandwidth, a step up or down."""
    values = gains_of(law)
    for key, by in product(values, (step, 1.0 / step)):
        yield from _with(law, {key: by * values[key]})
    if isinstance(law, Preset):
        for by in (step, 1.0 / step):
            yield replace(law, observer=law.observer.scaled(by))


def together(tried: Tried, neighbours: Sequence[Tried]) -> list[Searched]:
    """The law with every gain as the best of its better neighbours has it, where several gains are better so."""
    values = gains_of(tried.law)
    better = sorted((each for each in neighbours if each.cost < tried.cost), key=lambda each: -each.cost)
    changed = {key: value for each in better for key, value in gains_of(each.law).items() if value != values[key]}
    return list(_with(tried.law, changed)) if len(changed) > 1 else []


def gains_of(law: Searched) -> dict[str, float]:
    """What is moved of it, by name."""
    if isinstance(law, ChosenLaw):
        return dict(law.law)
    return {key: getattr(law.follower, key) for key in SEARCHED[type(law.follower)]}


def _with(law: Searched, changed: dict[str, Any]) -> Iterator[Searched]:
    """The law with these gains; nothing where it refuses them."""
    if isinstance(law, Preset):
        yield replace(law, follower=replace(law.follower, **changed))
        return
    new = replace(law, law=tuple((dict(law.law) | changed).items()))
    with suppress(ValueError):
        new.maker()
        yield new


def judge(task: Task, laws: Sequence[Searched], runner: Runner, worth: float = np.inf) -> list[Tried]:
    """Fly and cost each, the next of EACH with all that do not cost `worth` yet; infinite if so much."""
    costs, flown = np.zeros(len(laws)), np.zeros(len(laws), np.int64)
    for experiment, off in EACH:
        left = np.flatnonzero(costs < worth).tolist()
        flights = [Flight(task, task.profile.gain_scale, experiment, off, laws[k]) for k in left]
        costs[left] += runner.run("flights", fly, flights)
        flown[left] += 1
    costs = np.where(costs < worth, costs, np.inf)
    return [Tried(*each) for each in zip(laws, costs.tolist(), flown.tolist(), strict=True)]

"""`gcs-sim tune PROFILE --gains PRESET`, or `--law FILE.py`: the gains of a law, each by itself, found by flying.

The same compass search, flights, costs and effort as for the scales of a vehicle's loops (sim.studies.tune), whatever
the law, so that laws can be compared each with the gains that it flies best with.
"""

from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import islice, product

from formation.control.gains import CascadeGains, Gains, GeometricGains, SlidingGains
from formation.control.presets import Preset, preset_for
from sim.studies.laws import ChosenLaw
from sim.studies.runner import Runner
from sim.studies.tune import EXPERIMENTS, Flight, Task, compass, fly

SEARCHED: dict[type[Gains], tuple[str, ...]] = {
    SlidingGains: ("c", "p1", "p2", "smooth_m_s"),
    CascadeGains: ("kp_position", "kp", "ki"),
    GeometricGains: ("kx", "kv", "ki", "mix"),
}
"""The gains that are moved; the observer's bandwidth is one more."""
EACH = tuple(product(EXPERIMENTS, (False, True)))
"""What each candidate flies: every experiment, with the vehicle as believed and not."""


@dataclass(frozen=True, slots=True)
class TriedLaw:
    """An own law with its options, and what it costs."""

    law: ChosenLaw
    cost: float


@dataclass(frozen=True, slots=True)
class Tried:
    """Gains, and what they cost."""

    gains: Preset
    cost: float


def search(task: Task, name: str, runner: Runner, better: Callable[[Tried], None]) -> Tried:
    """The best gains found from that preset's own on; ValueError if there is no such preset."""
    first = judge(task, [preset_for(name, task.profile, task.mocap)], runner)[0]

    def neighbours_of(tried: Tried, step: float) -> list[Tried]:
        return judge(task, list(neighbours(tried.gains, step)), runner)

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

    def neighbours_of(tried: TriedLaw, step: float) -> list[TriedLaw]:
        return judge_laws(task, list(neighbouring_laws(tried.law, step)), runner)

    return compass(first, neighbours_of, better)


def neighbouring_laws(law: ChosenLaw, step: float) -> Iterator[ChosenLaw]:
    """The laws with one option a step up or down, as far as they can be made so."""
    options = dict(law.law)
    for key, by in product(options, (step, 1.0 / step)):
        tried = replace(law, law=tuple((options | {key: by * options[key]}).items()))
        with suppress(ValueError):
            tried.maker()
            yield tried


def judge_laws(task: Task, laws: list[ChosenLaw], runner: Runner) -> list[TriedLaw]:
    """Fly and cost each."""
    scale = task.profile.gain_scale
    flights = [[Flight(task, scale, e, off, law=law) for e, off in EACH] for law in laws]
    return [TriedLaw(law, cost) for law, cost in zip(laws, _costs(flights, runner), strict=True)]


def judge(task: Task, presets: list[Preset], runner: Runner) -> list[Tried]:
    """Fly and cost each."""
    scale = task.profile.gain_scale
    flights = [[Flight(task, scale, e, off, gains) for e, off in EACH] for gains in presets]
    return [Tried(gains, cost) for gains, cost in zip(presets, _costs(flights, runner), strict=True)]


def _costs(flights: list[list[Flight]], runner: Runner) -> list[float]:
    """Fly them all at once; what those of each candidate cost together."""
    costs = iter(runner.run("flights", fly, [flight for each in flights for flight in each]))
    return [sum(islice(costs, len(each))) for each in flights]

"""Runs of the campaign, flown: a group shares one flight, which is flown once up to each onset and forked there.

A fork is as good as flying the run whole: until its onset a fault has no effect at all, luck included. Where the
process has other threads, each run is flown whole.
"""

import os
import pickle
import threading
import traceback
from collections.abc import Callable
from dataclasses import dataclass

from sim.faults.fault import Fault
from sim.lockstep import uncollected
from sim.proof.draw import Draw, faults_of, flight_of
from sim.proof.flight import Flight, begins_soon
from sim.proof.oracle import Verdict, Violation
from sim.scenario import Scenario

RAISED = "raised"
"""The kind of violation of a flight that ended by an error of ours."""
FORK_AHEAD_NS = 30_000_000
"""More than from one exposure of the cameras to the next."""


@dataclass(frozen=True, slots=True)
class Job:
    """Some runs of one campaign that share a flight."""

    draw: Draw
    group: int
    numbers: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class Run:
    """One run, flown; duration_s: of its flight as a whole."""

    number: int
    faults: tuple[Fault, ...]
    verdict: Verdict
    duration_s: float


@dataclass(frozen=True, slots=True)
class JobResult:
    """A job, flown: its runs in order, the seconds that were integrated, and those of one core that this took."""

    runs: tuple[Run, ...]
    simulated_s: float
    core_s: float


def fly_job(job: Job) -> JobResult:
    """Fly the runs of a job."""
    scenario = flight_of(job.draw, job.group)
    return fly_group(scenario, {number: faults_of(job.draw, number, scenario) for number in job.numbers})


def fly_group(scenario: Scenario, faults: dict[int, tuple[Fault, ...]]) -> JobResult:
    """Fly the scenario once with each entry's faults, forked where that can be done."""
    before_s = _core_s()
    with uncollected():
        flown = _fork_along(scenario, faults) if threading.active_count() == 1 else _fly_each(scenario, faults)
    runs = tuple(sorted((run for run, _ in flown), key=lambda run: run.number))
    return JobResult(runs, sum(own_s for _, own_s in flown), _core_s() - before_s)


def _fly_each(scenario: Scenario, faults: dict[int, tuple[Fault, ...]]) -> list[tuple[Run, float]]:
    flown = []
    for number, these in faults.items():
        run = _finish(Flight(scenario.model_copy(update={"faults": these}), scenario.seed), number, these)
        flown.append((run, run.duration_s))
    return flown


def _fork_along(scenario: Scenario, faults: dict[int, tuple[Fault, ...]]) -> list[tuple[Run, float]]:
    """The runs, each with the seconds that were integrated for it; those of the shared flight count for its last."""
    flight, remaining = Flight(scenario, scenario.seed), dict(faults)
    flown: list[tuple[Run, float]] = []
    over = False
    while remaining and not over:
        for number in [number for number in remaining if begins_soon(flight, remaining[number], FORK_AHEAD_NS)]:
            these = remaining.pop(number)

            def fly_on(number: int = number, these: tuple[Fault, ...] = these) -> Run:
                flight.world.inject(these)
                return _finish(flight, number, these)

            run = _forked(fly_on)
            if isinstance(run, str):
                raised = Violation(RAISED, flight.t_s, run)
                run = Run(number, these, Verdict((raised,), flight.t_s, None, 0.0), flight.t_s)
            flown.append((run, run.duration_s - flight.t_s))
        over = over or (bool(remaining) and flight.advance())
    # What is left never began.
    flown += [(_judged(flight, number, these), 0.0) for number, these in remaining.items()]
    last, own_s = flown[-1]
    return [*flown[:-1], (last, own_s + flight.t_s)]


def _finish(flight: Flight, number: int, faults: tuple[Fault, ...]) -> Run:
    while not flight.advance():
        pass
    return _judged(flight, number, faults)


def _judged(flight: Flight, number: int, faults: tuple[Fault, ...]) -> Run:
    return Run(number, faults, flight.verdict(), flight.t_s)


def _forked(work: Callable[[], Run]) -> Run | str:
    """The result of `work` in a child of this process; where it raises, the traceback's last lines."""
    reads, writes = os.pipe()
    child = os.fork()
    if child == 0:
        outcome: Run | str = ""
        try:
            os.close(reads)
            outcome = work()
        finally:  # an exception on its way ends here too: what the stack holds further down is the parent's
            with os.fdopen(writes, "wb") as pipe:
                pickle.dump(outcome or traceback.format_exc(limit=-2), pipe)
            os._exit(0)
    os.close(writes)
    with os.fdopen(reads, "rb") as pipe:
        data = pipe.read()
    os.waitpid(child, 0)
    result = pickle.loads(data) if data else "the forked flight died"
    return result if isinstance(result, Run) else str(result)


def _core_s() -> float:
    """Seconds of a core that this process and its children have had."""
    times = os.times()
    return times.user + times.system + times.children_user + times.children_system

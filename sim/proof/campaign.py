"""A campaign: many runs on every core or on a cluster, what failed made small, one summary.

A failing run is made small without a fault, shorter or milder, as long as it still fails in the same way.
"""

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from typing import Protocol, TypeVar

from rich.console import Console

from sim.faults.fault import FAMILIES, Fault
from sim.proof.draw import GROUP, Draw, run_of
from sim.proof.flight import fly as fly_whole
from sim.proof.group import RAISED, Job, JobResult, Run, fly_job
from sim.proof.oracle import Margin, Violation
from sim.scenario import Scenario

MOST_SHRUNK, MOST_FLIGHTS = 4, 10
MOST_NEAR = 5
A = TypeVar("A")
B = TypeVar("B")


class Workers(Protocol):
    """Whoever does jobs: this machine's cores, or a cluster; results in the order of the jobs."""

    def run(self, title: str, work: Callable[[A], B], jobs: Sequence[A]) -> list[B]:
        """`work(job)` for every job."""


@dataclass(frozen=True, slots=True)
class Failure:
    """A run that was not contained: how, and by which faults, or the least of them that still does it, where known."""

    draw: Draw
    number: int
    violation: Violation
    faults: tuple[Fault, ...]

    @property
    def reason(self) -> str:
        """The first violation, in words."""
        return f"{self.violation.kind}: {self.violation.text}"

    @property
    def again(self) -> str:
        """The command that flies it again."""
        return self.draw.again(self.number)


@dataclass(frozen=True, slots=True)
class ClosestRun:
    """A run that was contained, and the limit of which it used most."""

    draw: Draw
    number: int
    margin: Margin


@dataclass(frozen=True, slots=True)
class Result:
    """The result of a campaign. simulated_s: seconds that were integrated, fewer than were flown where flights fork.

    nearest: the contained runs that came nearest to a limit, the nearest first.
    """

    runs: int
    failures: tuple[Failure, ...]
    separation_violations: int
    fence_violations: int
    virtual_s: float
    simulated_s: float
    core_s: float
    nearest: tuple[ClosestRun, ...] = ()

    def to_json(self, controls: Mapping[str, float], with_monitors: Mapping[str, float] | None = None) -> str:
        """For scripts. controls: by monitor, the share of flights that failed without it; with_monitors: with it."""
        return json.dumps(
            {
                "runs": self.runs,
                "uncontained": len(self.failures),
                "separation_violations": self.separation_violations,
                "fence_violations": self.fence_violations,
                "virtual_s_per_s_per_core": round(self.virtual_s / max(self.core_s, 1e-9), 2),
                "simulated_s_per_s_per_core": round(self.simulated_s / max(self.core_s, 1e-9), 2),
                "failures": [
                    {
                        "seed": f"{failure.draw.seed}:{failure.number}",
                        "again": failure.again,
                        "faults": [fault.model_dump(mode="json", exclude_defaults=True) for fault in failure.faults],
                        "reason": failure.reason,
                    }
                    for failure in self.failures
                ],
                "nearest": [
                    {
                        "again": near.draw.again(near.number),
                        "kind": near.margin.kind,
                        "used": round(near.margin.used, 3),
                        "text": near.margin.text,
                    }
                    for near in self.nearest
                ],
                "positive_controls": dict(controls),
                "with_monitors_on": dict(with_monitors or {}),
            },
            indent=2,
        )


def fly(draw: Draw, runs: range, workers: Workers, *, shrinks: bool = True) -> Result:
    """Fly these runs of a campaign; shrinks: make what fails small, of the first few."""
    groups = groupby(runs, lambda number: number // GROUP)
    flown = workers.run("flights", fly_job, [Job(draw, group, tuple(numbers)) for group, numbers in groups])
    return summarise(draw, flown, workers if shrinks else None)


def summarise(draw: Draw, flown: Sequence[JobResult], workers: Workers | None = None) -> Result:
    """The result of these jobs; workers: who makes the first failures small, if anybody."""
    runs = [run for job in flown for run in job.runs]
    failures = [
        Failure(draw, run.number, run.verdict.violations[0], run.faults) for run in runs if not run.verdict.contained
    ]
    if workers is not None and failures:
        small = workers.run("making failures small", shrunk, failures[:MOST_SHRUNK])
        failures[: len(small)] = small
    kinds = [set(run.verdict.kinds) for run in runs]
    return Result(
        len(runs), tuple(failures), sum("separation" in kind for kind in kinds), sum("fence" in kind for kind in kinds),
        sum(run.duration_s for run in runs), sum(job.simulated_s for job in flown), sum(job.core_s for job in flown),
        _nearest(draw, runs),
    )  # fmt: skip


def shrunk(failure: Failure) -> Failure:
    """The failure with the least that does it; as it is where its flight cannot even be flown to its end."""
    if failure.violation.kind == RAISED:
        return failure
    return replace(failure, faults=shrink(run_of(failure.draw, failure.number)))


def _nearest(draw: Draw, runs: Sequence[Run]) -> tuple[ClosestRun, ...]:
    near = [
        ClosestRun(draw, run.number, max(run.verdict.margins, key=lambda margin: margin.used))
        for run in runs
        if run.verdict.contained and run.verdict.margins
    ]
    return tuple(sorted(near, key=lambda one: -one.margin.used)[:MOST_NEAR])


def shrink(scenario: Scenario) -> tuple[Fault, ...]:
    """The least of the scenario's faults, which fail, that is found to fail in at most `MOST_FLIGHTS` flights."""
    kinds = set(fly_whole(scenario, scenario.seed).verdict.kinds)
    best, flights = scenario.faults, 1
    again = True
    while again and flights < MOST_FLIGHTS:
        again = False
        for faults in _smaller(best):
            if flights == MOST_FLIGHTS:
                break
            flights += 1
            tried = fly_whole(scenario.model_copy(update={"faults": faults}), scenario.seed).verdict
            if set(tried.kinds) & kinds:
                best, again = faults, True
                break
    return best


def _smaller(faults: tuple[Fault, ...]) -> Iterator[tuple[Fault, ...]]:
    """One fault less; then each half as long; then each half as severe, where less of it is milder."""
    if len(faults) > 1:
        for i in range(len(faults)):
            yield faults[:i] + faults[i + 1 :]
    for i, fault in enumerate(faults):
        if fault.for_s is not None and fault.for_s > 0.02:
            yield _with(faults, i, for_s=round(0.5 * fault.for_s, 4))
        if FAMILIES[fault.family].zero_is_none:
            yield _with(faults, i, severity=float(f"{0.5 * fault.severity:.3g}"))


def _with(faults: tuple[Fault, ...], i: int, **change: object) -> tuple[Fault, ...]:
    return (*faults[:i], faults[i].model_copy(update=change), *faults[i + 1 :])


class Cluster:
    """The workers of one Dask scheduler (the extra `research`), which need this project installed."""

    def __init__(self, address: str, console: Console) -> None:
        """OSError if there is no scheduler; ImportError without the extra."""
        from distributed import Client

        self._client = Client(address)
        self._console = console

    def run(self, title: str, work: Callable[[A], B], jobs: Sequence[A]) -> list[B]:
        """`work(job)` for every job, in the order of the jobs. Raises what a job raises."""
        from distributed import as_completed

        futures = self._client.map(work, jobs, pure=False)
        with self._console.status(title) as status:
            for done, _ in enumerate(as_completed(futures), 1):
                status.update(f"{title}: {done} of {len(jobs)}")
        return list(self._client.gather(futures))

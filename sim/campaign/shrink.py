"""A failing run made small: without a fault, shorter or milder, as long as it still fails in the same way."""

from collections.abc import Iterator
from dataclasses import dataclass

from sim.campaign.flight import fly
from sim.campaign.oracle import Verdict
from sim.faults.fault import FAMILIES, Fault
from sim.scenario import Scenario

MOST_FLIGHTS = 10


@dataclass(frozen=True, slots=True)
class Shrunk:
    """The smallest that still fails, and how."""

    faults: tuple[Fault, ...]
    verdict: Verdict


def shrink(scenario: Scenario) -> Shrunk:
    """Shrink the scenario's faults, which fail, in at most `MOST_FLIGHTS` flights."""
    verdict = fly(scenario, scenario.seed).verdict
    best, flights = Shrunk(scenario.faults, verdict), 1
    again = True
    while again and flights < MOST_FLIGHTS:
        again = False
        for faults in _smaller(best.faults):
            if flights == MOST_FLIGHTS:
                break
            flights += 1
            tried = fly(scenario.model_copy(update={"faults": faults}), scenario.seed).verdict
            if set(tried.kinds) & set(verdict.kinds):
                best, again = Shrunk(faults, tried), True
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

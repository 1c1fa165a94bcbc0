"""Other processes that a program needs: it reports soon which one is missing, and what to do."""

import asyncio
from collections.abc import Awaitable, Callable, Sequence
from dataclasses import dataclass

from formation.messages import Event, Severity
from wire.process.lifetime import EventSink

PATIENCE_S = 0.5
"""No report before that, s: processes started together are there by then."""
_POLL_S, _ASK_EVERY = 0.2, 10


@dataclass(frozen=True, slots=True)
class Awaited:
    """Something that others bring: its name, whether it is there, and what to do where it is not."""

    what: str
    is_there: Callable[[], bool]
    remedy: str


GROUND_REMEDY = "start one with `gcs run lab.toml`; --name says which one is meant"


def bus_at(endpoints: Sequence[str], is_there: Callable[[], bool], remedy: str) -> Awaited:
    """Anybody else on the lab's bus."""
    return Awaited(f"the bus at {', '.join(endpoints) or 'no endpoint'}", is_there, remedy)


async def _nobody() -> str:
    return ""


async def report_missing(
    source: str, awaited: Sequence[Awaited], report: EventSink, others: Callable[[], Awaitable[str]] = _nobody
) -> None:
    """Report once what is missing and what to do, then when it is there; return when nothing is missing.

    others: who of other labs is on the bus, in words; reported once, as long as something is missing.
    """
    await asyncio.sleep(PATIENCE_S)
    missing = [need for need in awaited if not need.is_there()]
    for need in missing:
        report(Event(Severity.NOTICE, source, f"waiting for {need.what}: {need.remedy}"))
    polls, there = 0, ""
    while missing:
        if not there and polls % _ASK_EVERY == 0 and (there := await others()):
            report(
                Event(Severity.NOTICE, source, f"on the bus, but not of this lab: {there}. Is the lab's name right?")
            )
        polls += 1
        await asyncio.sleep(_POLL_S)
        for need in [need for need in missing if need.is_there()]:
            missing.remove(need)
            report(Event(Severity.INFO, source, f"no longer waiting for {need.what}"))

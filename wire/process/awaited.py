"""What a program needs of others before it can work: said soon where it is missing, with what to do about it."""

import asyncio
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from formation.messages import Event, Severity
from wire.process.lifetime import Tell

PATIENCE_S = 0.5
"""How long nothing is said: what starts together is there by then, and a program has started within a second."""
_LOOK_S = 0.2


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


async def tell_awaited(source: str, awaited: Sequence[Awaited], tell: Tell) -> None:
    """Say what is missing, and what to do, once; then say when it has come; return when all is there."""
    await asyncio.sleep(PATIENCE_S)
    missing = [need for need in awaited if not need.is_there()]
    for need in missing:
        tell(Event(Severity.NOTICE, source, f"waiting for {need.what}: {need.remedy}"))
    while missing:
        await asyncio.sleep(_LOOK_S)
        for need in [need for need in missing if need.is_there()]:
            missing.remove(need)
            tell(Event(Severity.INFO, source, f"no longer waiting for {need.what}"))

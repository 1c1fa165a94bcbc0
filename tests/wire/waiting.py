"""Waiting with an end to it."""

import asyncio
from collections.abc import Callable
from contextlib import suppress

PATIENCE_S = 30.0


async def until(event: asyncio.Event, act: Callable[[], object] = lambda: None) -> None:
    """Do `act` again and again until `event` is set; TimeoutError after PATIENCE_S."""
    async with asyncio.timeout(PATIENCE_S):
        while not event.is_set():
            act()
            with suppress(TimeoutError):
                await asyncio.wait_for(event.wait(), 0.02)

"""Tests in an event loop, and waiting with an end to it."""

import asyncio
from collections.abc import Callable, Coroutine
from contextlib import suppress
from functools import wraps
from typing import Any

PATIENCE_S = 30.0


def in_loop(test: Callable[..., Coroutine[Any, Any, None]]) -> Callable[..., None]:
    """The test, run in an event loop of its own."""
    return wraps(test)(lambda *given, **named: asyncio.run(test(*given, **named)))


async def until(event: asyncio.Event, act: Callable[[], object] = lambda: None) -> None:
    """Do `act` again and again until `event` is set; TimeoutError after PATIENCE_S."""
    async with asyncio.timeout(PATIENCE_S):
        while not event.is_set():
            act()
            with suppress(TimeoutError):
                await asyncio.wait_for(event.wait(), 0.02)

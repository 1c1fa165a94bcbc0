"""Waiting with an end to it, and ports that are free."""

import asyncio
import socket
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


def free_port(kind: socket.SocketKind) -> int:
    """A port that nobody has right now."""
    with socket.socket(socket.AF_INET, kind) as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]

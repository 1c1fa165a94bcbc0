"""The way from other threads to the event loop: bounded, the oldest lost, one wake-up for many items."""

import asyncio
from collections import deque
from collections.abc import Callable
from typing import Generic, TypeVar

from wire.link import LinkCounters

T = TypeVar("T")


class Inbox(Generic[T]):
    """Hands items from Zenoh's threads to the event loop, one wake-up for many; when full the oldest is lost."""

    def __init__(
        self, loop: asyncio.AbstractEventLoop, take: Callable[[T], None], counters: LinkCounters, limit: int
    ) -> None:
        self._loop = loop
        self._take = take
        self._counters = counters
        self._queue: deque[T] = deque(maxlen=limit)
        self._awake = False
        self._open = True

    def put(self, item: T) -> None:
        """From any thread."""
        if len(self._queue) == self._queue.maxlen:
            self._counters.dropped += 1
        self._queue.append(item)
        if not self._awake:
            self._awake = True
            on_loop(self._loop, self._drain)

    def close(self) -> None:
        """Deliver nothing more."""
        self._open = False

    def _drain(self) -> None:
        # Cleared first: what is put from here on either is taken below or wakes the loop again.
        self._awake = False
        while self._queue and self._open:
            self._counters.received += 1
            self._take(self._queue.popleft())


def on_loop(loop: asyncio.AbstractEventLoop, call: Callable[[], None]) -> None:
    """Have the loop make a call, from any thread; nothing happens once it has closed."""
    try:
        loop.call_soon_threadsafe(call)
    except RuntimeError:  # the loop has closed: nobody is left to tell
        return

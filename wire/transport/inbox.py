"""A bounded queue from other threads to the event loop; the oldest item is lost, one wake-up delivers many."""

import asyncio
from collections import deque
from collections.abc import Callable
from typing import Generic, TypeVar

from wire.transport.link import PAUSE_S, LinkCounters

T = TypeVar("T")


class Inbox(Generic[T]):
    """Hands items from Zenoh's threads to the event loop, one wake-up for many; when full the oldest is lost.

    `turn`: how many items it delivers in a row; the others wait for PAUSE_S. None: all.
    """

    def __init__(
        self,
        loop: asyncio.AbstractEventLoop,
        deliver: Callable[[T], None],
        counters: LinkCounters,
        limit: int,
        turn: int | None = None,
    ) -> None:
        self._loop = loop
        self._deliver = deliver
        self._counters = counters
        self._queue: deque[T] = deque(maxlen=limit)
        self._turn = turn
        self._resting = False
        self._awake = False
        self._open = True

    def enqueue(self, item: T) -> None:
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
        if self._resting:
            return  # and stay awake: nobody need wake the loop before the pause is over
        # Cleared first: an item queued from here on is either delivered below or wakes the loop again.
        self._awake = False
        delivered = 0
        while self._queue and self._open:
            if delivered == self._turn:
                self._resting = True
                self._loop.call_later(PAUSE_S, self._resume)
                return
            delivered += 1
            self._counters.received += 1
            self._deliver(self._queue.popleft())

    def _resume(self) -> None:
        self._resting = False
        self._drain()


def on_loop(loop: asyncio.AbstractEventLoop, call: Callable[[], None]) -> None:
    """Call on the loop, from any thread; nothing happens once the loop has closed."""
    try:
        loop.call_soon_threadsafe(call)
    except RuntimeError:  # the loop has closed
        return

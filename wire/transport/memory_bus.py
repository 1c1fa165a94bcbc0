"""A link inside one process, for the lockstep host: what is pushed comes out after a modelled delay, in order."""

from collections import deque
from collections.abc import Callable
from typing import Generic, TypeVar

import numpy as np

T = TypeVar("T")

NOTHING_DUE_NS = 2**63 - 1

# The delay of the next item, or None where it is lost.
DelayModel = Callable[[], int | None]


def random_delay(delay_s: float, jitter_s: float, loss: float, rng: np.random.Generator) -> DelayModel:
    """`delay_s` plus an exponential tail of mean `jitter_s`; each item is lost with probability `loss`."""

    uniform, exponential = rng.random, rng.standard_exponential

    def draw() -> int | None:
        # Both are drawn for every item, so that the loss of one does not shift the delays of the others.
        lost, tail = uniform() < loss, jitter_s * exponential()
        return None if lost else round((delay_s + tail) * 1e9)

    return draw


class MemoryLink(Generic[T]):
    """A one-way queue with delay; items never overtake each other, as on a wire."""

    def __init__(self, delay: DelayModel) -> None:
        self.lost = 0
        self.next_due_ns = NOTHING_DUE_NS
        """When the next item arrives; NOTHING_DUE_NS if nothing is under way."""
        self._delay = delay
        self._queue: deque[tuple[int, T]] = deque()

    def push(self, t_ns: int, item: T) -> None:
        """Send `item` at `t_ns`."""
        delay_ns = self._delay()
        if delay_ns is None:
            self.lost += 1
            return
        due_ns = t_ns + delay_ns
        if self._queue:
            due_ns = max(due_ns, self._queue[-1][0])
        else:
            self.next_due_ns = due_ns
        self._queue.append((due_ns, item))

    def pop_due(self, now_ns: int) -> list[tuple[int, T]]:
        """The items that have arrived by `now_ns`, each with its time of arrival, in order."""
        due: list[tuple[int, T]] = []
        if now_ns < self.next_due_ns:
            return due
        while self._queue and self._queue[0][0] <= now_ns:
            due.append(self._queue.popleft())
        self.next_due_ns = self._queue[0][0] if self._queue else NOTHING_DUE_NS
        return due

"""A queue of items on their way: they come out when they are due, and may overtake each other."""

import heapq
from typing import Generic, TypeVar

from wire.transport.memory_bus import NOTHING_DUE_NS

T = TypeVar("T")


class DueQueue(Generic[T]):
    """Items by the time at which they are due; of two at one time the one that was put in first."""

    def __init__(self) -> None:
        self.next_due_ns = NOTHING_DUE_NS
        """When the next item is due."""
        self._heap: list[tuple[int, int, T]] = []
        self._count = 0

    def push(self, due_ns: int, item: T) -> None:
        """Put an item in."""
        heapq.heappush(self._heap, (due_ns, self._count, item))
        self._count += 1
        self.next_due_ns = self._heap[0][0]

    def pop_due(self, now_ns: int) -> list[T]:
        """The items due by now, in order."""
        due: list[T] = []
        if now_ns < self.next_due_ns:
            return due
        while self._heap and self._heap[0][0] <= now_ns:
            due.append(heapq.heappop(self._heap)[2])
        self.next_due_ns = self._heap[0][0] if self._heap else NOTHING_DUE_NS
        return due

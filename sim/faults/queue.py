"""A queue of items on their way: they come out when they are due, and may overtake each other; and who is due when."""

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


class Agenda:
    """When each of n is due next: who is due now is found without a look at everybody."""

    def __init__(self, count: int, now_ns: int) -> None:
        """All are due now."""
        self.next_due_ns = now_ns
        """When the first of them is due."""
        self._due_ns = [now_ns] * count
        self._heap = [(now_ns, row) for row in range(count)]

    def set_due(self, row: int, due_ns: int) -> None:
        """That one is due then, whatever was set before."""
        before_ns = self._due_ns[row]
        if due_ns == before_ns:
            return
        self._due_ns[row] = due_ns
        heapq.heappush(self._heap, (due_ns, row))
        if due_ns < self.next_due_ns:
            self.next_due_ns = due_ns
        elif before_ns == self.next_due_ns:  # it may have been the first
            self._find_next()

    def pop_due(self, now_ns: int) -> list[int]:
        """Who is due by now, in order of their rows; for each the next time is to be set."""
        due: set[int] = set()
        while self.next_due_ns <= now_ns:
            _, row = heapq.heappop(self._heap)
            self._due_ns[row] = NOTHING_DUE_NS
            due.add(row)
            self._find_next()
        return sorted(due)

    def _find_next(self) -> None:
        heap, due_ns = self._heap, self._due_ns
        while heap and heap[0][0] != due_ns[heap[0][1]]:
            heapq.heappop(heap)  # set anew since
        self.next_due_ns = heap[0][0] if heap else NOTHING_DUE_NS

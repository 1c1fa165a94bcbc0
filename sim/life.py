"""Whether a core lives: what comes while it is stalled waits for it, what comes while it is dead is lost."""

from enum import Enum, auto
from typing import Generic, TypeVar

T = TypeVar("T")


class Life(Enum):
    """How a process is."""

    ALIVE = auto()
    STALLED = auto()
    DEAD = auto()


class Waiting(Generic[T]):
    """The input of one core."""

    def __init__(self) -> None:
        self.runs = True
        """Whether it takes its input in, and its turns."""
        self._life = Life.ALIVE
        self._held: list[T] = []

    def admits(self, item: T) -> bool:
        """Whether the core takes it in now; else it is kept for a core that is stalled."""
        if self._life is Life.STALLED:
            self._held.append(item)
        return self.runs

    def stall(self) -> None:
        """It stops where it is."""
        if self.runs:
            self._become(Life.STALLED)

    def kill(self) -> None:
        """It is gone, with what was waiting for it."""
        self._become(Life.DEAD)
        self._held.clear()

    def wake(self) -> list[T]:
        """It goes on, or is there anew; what it has to take in first."""
        self._become(Life.ALIVE)
        held, self._held = self._held, []
        return held

    def _become(self, life: Life) -> None:
        self._life, self.runs = life, life is Life.ALIVE

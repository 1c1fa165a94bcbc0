"""The input of a simulated process: it waits while the process is stalled, and is lost while it is dead."""

from enum import Enum, auto
from typing import Generic, TypeVar

T = TypeVar("T")


class Life(Enum):
    """The state of a process."""

    ALIVE = auto()
    STALLED = auto()
    DEAD = auto()


class ProcessInput(Generic[T]):
    """The input of one core, and the state of its process."""

    def __init__(self) -> None:
        self.runs = True
        """Whether it receives its input and ticks."""
        self.lives = True
        """Whether the process exists, stalled or not."""
        self._life = Life.ALIVE
        self._held: list[T] = []

    def admits(self, item: T) -> bool:
        """Whether the core receives the item now; a stalled core gets it later."""
        if self._life is Life.STALLED:
            self._held.append(item)
        return self.runs

    def stall(self) -> None:
        """Suspend the process."""
        if self.runs:
            self._become(Life.STALLED)

    def kill(self) -> None:
        """End the process; its waiting input is lost."""
        self._become(Life.DEAD)
        self._held.clear()

    def resume(self) -> list[T]:
        """Continue or restart the process; returns the input that waits for it."""
        self._become(Life.ALIVE)
        held, self._held = self._held, []
        return held

    def _become(self, life: Life) -> None:
        self._life, self.runs, self.lives = life, life is Life.ALIVE, life is not Life.DEAD

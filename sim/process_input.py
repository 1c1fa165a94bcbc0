"""The input of a simulated process: it waits while the process is stalled, and is lost while it is dead."""

from typing import Generic, TypeVar

T = TypeVar("T")


class ProcessInput(Generic[T]):
    """The input of one core, and the state of its process."""

    def __init__(self) -> None:
        self.runs = True
        """Whether it receives its input and ticks."""
        self.lives = True
        """Whether the process exists, stalled or not."""
        self._held: list[T] = []

    def admits(self, item: T) -> bool:
        """Whether the core receives the item now; a stalled core gets it later."""
        if self.lives and not self.runs:
            self._held.append(item)
        return self.runs

    def stall(self) -> None:
        """Suspend the process."""
        self.runs = False

    def kill(self) -> None:
        """End the process; its waiting input is lost."""
        self.runs = self.lives = False
        self._held.clear()

    def resume(self) -> list[T]:
        """Continue or restart the process; returns the input that waits for it."""
        self.runs = self.lives = True
        held, self._held = self._held, []
        return held

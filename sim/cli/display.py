"""What a person sees of a run while it goes on: the phases as they come, and a line that is alive."""

from types import TracebackType
from typing import Self

from rich.console import Console
from rich.text import Text


class Display:
    """A context in which `progress` keeps a status line up to date and leaves a line for each phase."""

    def __init__(self, console: Console, title: str) -> None:
        self._console = console
        self._title = title
        self._status = console.status(Text(title))
        self._phase = ""

    def __enter__(self) -> Self:
        self._status.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, where: TracebackType | None
    ) -> None:
        self._status.stop()

    def update(self, text: str) -> None:
        """Show what is going on, without a time."""
        self._status.update(Text(f"{self._title}: {text}"))

    def progress(self, t_s: float, phase: str) -> None:
        """The flight is in `phase`, `t_s` after its beginning."""
        if phase != self._phase:
            self._phase = phase
            self._console.print(f"{t_s:7.1f} s  {phase}", highlight=False, markup=False)
        self._status.update(Text(f"{self._title}: {phase}, {t_s:.1f} s"))

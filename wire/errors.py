"""Mistakes in input, in one line a fault."""

from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Fault:
    """The fault of one key: `followers[1].offset_m`, its value as written if that is short, and why."""

    key: str
    value: str
    reason: str

    def __str__(self) -> str:
        return self.text(self.key)

    def text(self, at: str) -> str:
        """The same, begun by where it is."""
        return f"{at}{': ' if at else ''}{self.reason}{f' (it is {self.value})' if self.value else ''}"


class ConfigError(ValueError):
    """A configuration that cannot be used; `problems` has one line a fault, `str` is all of them.

    faults: the same by key, where it was read at all; source: the file that has them.
    """

    def __init__(self, problems: Sequence[str], faults: Sequence[Fault] = (), source: str = "") -> None:
        super().__init__("\n".join(problems))
        self.problems = list(problems)
        self.faults = tuple(faults)
        self.source = source


def error_text(error: BaseException) -> str:
    """An error in one line; a file's is led by the file's name, without a number."""
    if isinstance(error, OSError) and error.strerror:
        return f"{error.filename}: {error.strerror}" if error.filename else error.strerror
    return str(error)


class BusError(OSError):
    """The bus could not be opened: an endpoint that is taken or not an endpoint, a name that cannot be a key."""

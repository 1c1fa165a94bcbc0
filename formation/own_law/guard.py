"""How long a lab's own laws may take, decided by who runs them: the host has a clock, the control has none."""

from collections.abc import Callable
from typing import Protocol, TypeVar

Answer = TypeVar("Answer")


class LawOverrunError(BaseException):
    """The laws have not answered in time. No Exception, so that a law's own `except Exception` does not catch it."""


class LawGuard(Protocol):
    """Calls the laws of one tick."""

    def __call__(self, now_ns: int, call: Callable[[], Answer], /) -> Answer:
        """What `call` returns; whatever it raises, and LawOverrunError where it takes longer than it may.

        now_ns: the tick's time, by which a replay knows in which tick that was.
        """


def unlimited(_now_ns: int, call: Callable[[], Answer]) -> Answer:
    """As long as it takes."""
    return call()

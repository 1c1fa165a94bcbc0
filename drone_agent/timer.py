"""The timer for a daemon's core: it fires at the core's next deadline."""

import asyncio
from collections.abc import Callable

from wire.clock import REAL_TIME, Clock


class DeadlineTimer:
    """Calls `turn` at a deadline; a new deadline takes the old one's place."""

    def __init__(self, turn: Callable[[], None], clock: Clock = REAL_TIME) -> None:
        self._turn = turn
        self._clock = clock
        self._loop = asyncio.get_running_loop()
        self._timer: asyncio.TimerHandle | None = None

    def at(self, deadline_ns: int) -> None:
        """Fire then, or at once where that is past."""
        self.stop()
        self._timer = self._loop.call_later(self._clock.seconds_until(deadline_ns), self._turn)

    def stop(self) -> None:
        """Cancel the timer."""
        if self._timer is not None:
            self._timer.cancel()

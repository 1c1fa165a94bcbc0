"""How a daemon's process ends: well on a signal, with its error on any other failure."""

import asyncio
import signal
from collections.abc import Callable
from typing import Any

from formation.messages import Event

EventSink = Callable[[Event], None]
"""Where a daemon's events go."""


class Stop:
    """A signal ends the process well; an exception anywhere in the loop ends it with that exception."""

    def __init__(self) -> None:
        self._event = asyncio.Event()
        self._error: BaseException | None = None
        loop = asyncio.get_running_loop()
        for number in (signal.SIGINT, signal.SIGTERM):
            loop.add_signal_handler(number, self._event.set)
        loop.set_exception_handler(self._fail)

    def _fail(self, _loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
        self._error = context.get("exception") or RuntimeError(context["message"])
        self._event.set()

    async def wait(self) -> None:
        """Return on a signal; raise what went wrong."""
        await self._event.wait()
        if self._error is not None:
            raise self._error

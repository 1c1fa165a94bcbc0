"""A daemon's life: it reports which other processes it needs are missing, and ends on a signal or with its error.

To its service manager it reports by systemd's sd_notify, datagrams to the socket that the manager names; without one
nothing is sent, and one that does not take a datagram at once goes without: it stops no flight.
A simulator that cannot keep up ends, too: what it shows is no flight, and nothing that flies in it is to blame.
"""

import asyncio
import os
import signal
import socket
from collections.abc import AsyncIterator, Awaitable, Callable, Coroutine, Sequence
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass
from typing import Any

from formation.messages import Event, Severity
from wire import clock
from wire.process.port_holder import listener
from wire.rejections import RejectionLog
from wire.text import plain

EventSink = Callable[[Event], None]
"""Where a daemon's events go."""


class LoopErrors:
    """Counts errors of the event loop that end no process, such as a library's, and reports them once a second."""

    def __init__(self, report: EventSink) -> None:
        self._report = report
        self._log, self._waits = RejectionLog("failed"), False

    def receive(self, context: dict[str, Any]) -> None:
        """Receive what asyncio hands to an exception handler."""
        error = context.get("exception")
        why = "" if error is None else f": {type(error).__name__}: {error}"
        self._log.note("event loop", plain(f"{context['message']}{why}", 300), clock.monotonic_ns())
        if not self._waits:
            self._report_due()

    def _report_due(self) -> None:
        for event in self._log.due(clock.monotonic_ns()):
            self._report(event)
        self._waits = self._log.has_pending
        if self._waits:
            asyncio.get_running_loop().call_later(_POLL_S, self._report_due)


class Stop:
    """A signal ends the process well; a callback that raises ends it with that exception.

    What a task raises that nobody awaits is reported: it is a library's, or beside the process's work (`beside`).
    """

    def __init__(self, report: EventSink) -> None:
        self._event = asyncio.Event()
        self._error: BaseException | None = None
        self._others = LoopErrors(report)
        loop = asyncio.get_running_loop()
        for number in (signal.SIGINT, signal.SIGTERM):
            loop.add_signal_handler(number, self._event.set)
        loop.set_exception_handler(self._fail)

    def _fail(self, _loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
        if "handle" not in context:
            self._others.receive(context)
            return
        self._error = context.get("exception") or RuntimeError(context["message"])
        self._event.set()

    async def wait(self) -> None:
        """Return on a signal; raise what went wrong."""
        await self._event.wait()
        if self._error is not None:
            raise self._error


async def first_of(*parts: Any) -> None:
    """Return with the first part that ends, or raise what it raised; the others are cancelled."""
    tasks = [asyncio.ensure_future(part) for part in parts]
    try:
        done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        for task in done:
            task.result()
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)


@asynccontextmanager
async def beside(*parts: Coroutine[Any, Any, None]) -> AsyncIterator[None]:
    """While inside, run these beside it; they are cancelled with it. An error ends that part, and is reported."""
    tasks = [asyncio.create_task(part) for part in parts]
    for task in tasks:
        task.add_done_callback(_report_error)
    try:
        yield
    finally:
        for task in tasks:
            task.cancel()


def _report_error(task: "asyncio.Task[None]") -> None:
    error = None if task.cancelled() else task.exception()
    if error is not None:
        name = getattr(task.get_coro(), "__qualname__", task.get_name())
        task.get_loop().call_exception_handler({"message": f"{name} has ended", "exception": error})


PATIENCE_S = 0.5
"""No report before that, s: processes started together are there by then."""
_POLL_S = 0.2


@dataclass(frozen=True, slots=True)
class Precondition:
    """Something that others bring: its name, whether it is there, and what to do where it is not."""

    what: str
    is_there: Callable[[], bool]
    remedy: str


GROUND_REMEDY = "start one with `gcs run lab.toml`; --name says which one is meant"


def bus_at(endpoints: Sequence[str], is_there: Callable[[], bool], remedy: str) -> Precondition:
    """Anybody else on the lab's bus; remedy: where no other program of this machine has the port."""
    if holder := listener(endpoints):
        remedy = (
            f"{holder} has that port and does not answer as the bus: end it, or give the bus another port "
            "([link] zenoh_listen)"
        )
    return Precondition(f"the bus at {', '.join(endpoints) or 'no endpoint'}", is_there, remedy)


async def _nobody() -> str:
    return ""


async def report_missing(
    source: str, awaited: Sequence[Precondition], report: EventSink, others: Callable[[], Awaitable[str]] = _nobody
) -> None:
    """Report once what is missing and what to do, then when it is there; return when nothing is missing.

    The service manager learns it, too.
    others: who of other labs is on the bus, in words; reported once, as long as something is missing.
    """
    await asyncio.sleep(PATIENCE_S)
    missing = [need for need in awaited if not need.is_there()]
    for need in missing:
        report(Event(Severity.NOTICE, source, f"waiting for {need.what}: {need.remedy}"))
    polls, there = 0, ""
    while missing:
        notify(f"STATUS=waiting for {', '.join(need.what for need in missing)}")
        if not there and polls % 10 == 0 and (there := await others()):
            report(
                Event(Severity.NOTICE, source, f"on the bus, but not of this lab: {there}. Is the lab's name right?")
            )
        polls += 1
        await asyncio.sleep(_POLL_S)
        for need in [need for need in missing if need.is_there()]:
            missing.remove(need)
            report(Event(Severity.INFO, source, f"no longer waiting for {need.what}"))
    notify("STATUS=everything that is awaited is there")


STARVED = 3
"""Exit code of a simulator's process that was too late for its own schedule."""
LATE_NS = 100_000_000
"""The shortest time-out that a late simulator would trip: a drone levels without a setpoint for so long."""


class StarvedError(RuntimeError):
    """A simulator was too late for its own next event: the machine gives it too little time."""


@dataclass(frozen=True, slots=True)
class Punctuality:
    """Holds a simulator against its own schedule."""

    who: str
    what: str

    def check(self, due_ns: int, now_ns: int) -> None:
        """StarvedError where what was due comes later than LATE_NS."""
        if now_ns - due_ns > LATE_NS:
            late_ms = (now_ns - due_ns) * 1e-6
            raise StarvedError(f"{self.who} is starved: {self.what} {late_ms:.0f} ms late, the machine is too slow")


READY = "READY=1"
"""`systemctl start` returns, and what is ordered after this is started."""
FEED_NS = 200_000_000


def notify(state: str) -> None:
    """Send one state, as systemd's sd_notify(3) has them: READY, "STATUS=text"."""
    address = os.environ.get("NOTIFY_SOCKET", "")
    if address:
        name = f"\0{address[1:]}" if address.startswith("@") else address
        with suppress(OSError), socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as sender:
            sender.sendto(state.encode(), socket.MSG_DONTWAIT, name)


class Watchdog:
    """Says every FEED_NS that the process goes on; where it does not, its manager ends it after `WatchdogSec`."""

    def __init__(self) -> None:
        self._due_ns = 0

    def feed(self, now_ns: int) -> None:
        """Call it where the process does its work."""
        if now_ns >= self._due_ns:
            self._due_ns = now_ns + FEED_NS
            notify("WATCHDOG=1")

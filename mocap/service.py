"""A mocap process for a lab: the one that serves it already, or one of our own."""

import asyncio
import hashlib
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

from formation.config import LabConfig
from formation.messages import Event, Severity
from formation.requests import GCS_NAME
from wire.clock import REAL_TIME, Clock
from wire.process.daemon import EventSink
from wire.process.system import NOT_RIGHT, python_command
from wire.transport.mocap_bus import MocapBus

POLL_S = 0.2
AGAIN_S = 1.0
LINGER_S = 60.0
"""How long our process runs on after we were killed: drones land by its poses meanwhile, or another ground comes."""


class ServiceError(RuntimeError):
    """No mocap process can serve the lab; `code` is the exit code that fits."""

    def __init__(self, text: str, code: int = 1) -> None:
        super().__init__(text)
        self.code = code


def configuration_name(config: LabConfig) -> str:
    """A short name for everything that decides what a lab's frames are: who serves another name serves other frames."""
    bodies = [(v.body, v.q_marker_from_flu) for v in config.vehicles]
    text = f"{config.mocap.model_dump_json()} {bodies}"
    return hashlib.sha256(text.encode()).hexdigest()[:16]


@asynccontextmanager
async def mocap_service(
    config: LabConfig,
    lab_file: Path,
    bus: MocapBus,
    report: EventSink,
    clock: Clock = REAL_TIME,
    ground: str = GCS_NAME,
) -> AsyncIterator[None]:
    """While inside, a mocap process serves the lab; one of ours ends with us, but not if we are killed.

    ground: the name under which the ground is on the bus.
    Raises ServiceError where it cannot be started, or serves another configuration than `config`.
    """
    served = await bus.serving(1.0)
    if served is not None:
        if served != configuration_name(config):
            raise ServiceError("the mocap process that runs has other bodies or axes than this file: restart it")
        report(Event(Severity.INFO, "mocap", "frames come from the mocap process that is running"))
        yield
        return
    report(Event(Severity.INFO, "mocap", f"no mocap process serves {config.name!r}: starting `gcs mocap {lab_file}`"))
    own = _OwnProcess(lab_file, bus, report, clock, ground)
    await own.start()
    try:
        await own.until_serving()
        supervision = asyncio.create_task(own.supervise())
        try:
            yield
        finally:
            supervision.cancel()
    finally:
        await own.stop()


class _OwnProcess:
    """The mocap process that we started, and start again when it ends."""

    def __init__(self, lab_file: Path, bus: MocapBus, report: EventSink, clock: Clock, ground: str) -> None:
        self._ground = ground
        self._lab_file = lab_file
        self._clock = clock
        self._bus = bus
        self._report = report
        self._process: asyncio.subprocess.Process | None = None

    async def start(self) -> None:
        """In a session of its own, so that neither Ctrl-C nor our death takes the drones' poses away."""
        self._process = await asyncio.create_subprocess_exec(
            *python_command(
                "gcs", "mocap", str(self._lab_file), "--linger", str(LINGER_S), "--speed", str(self._clock.speed),
                "--name", self._ground, *(("--insecure",) if self._bus.insecure else ()),
            ),
            stdin=asyncio.subprocess.DEVNULL, start_new_session=True,
        )  # fmt: skip

    async def until_serving(self) -> None:
        """Return when a process serves the lab, however long compiling takes; ServiceError if ours ends instead."""
        while await self._bus.serving(POLL_S) is None:
            if self._process is not None and self._process.returncode is not None:
                code = self._process.returncode
                raise ServiceError(f"the mocap process ended ({_ended(code)}) and serves nobody", code or 1)

    async def supervise(self) -> None:
        """Restart the process when it ends, unless its configuration is wrong or another process serves by then."""
        while self._process is not None:
            code = await self._process.wait()
            self._report(Event(Severity.CRITICAL, "mocap", f"the mocap process ended ({_ended(code)})"))
            if code == NOT_RIGHT or not await self._starts_again():
                return

    async def _starts_again(self) -> bool:
        """Start the process again, however often the system refuses; False where another one serves by then."""
        while True:
            await asyncio.sleep(AGAIN_S)
            if await self._bus.serving(POLL_S) is not None:
                return False
            try:
                await self.start()
                return True
            except OSError as error:
                why = error.strerror or error
                self._report(
                    Event(Severity.CRITICAL, "mocap", f"the mocap process cannot be started ({why}): trying again")
                )

    async def stop(self) -> None:
        """End it, if it is still there."""
        if self._process is not None and self._process.returncode is None:
            self._process.terminate()
            await self._process.wait()


def _ended(code: int) -> str:
    return f"signal {-code}" if code < 0 else f"exit code {code}"

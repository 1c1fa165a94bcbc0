"""The operating-system processes of a real-time flight: started, watched and stopped together, whatever happens."""

import asyncio
import signal
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Self

from wire.process.daemon import STARVED
from wire.process.system import python_command

PATIENCE_S = 5.0


@dataclass(frozen=True, slots=True)
class Child:
    """One running process, what it is called, and where its output goes."""

    name: str
    process: asyncio.subprocess.Process
    output: Path
    patience_s: float
    command: tuple[str, ...]


class ProcessDied(RuntimeError):
    """A process of the flight ended while it was needed; starved: because it is a simulator that came too late."""

    def __init__(self, text: str, starved: bool = False) -> None:
        super().__init__(text)
        self.starved = starved


class ProcessGroup:
    """Python processes that live and end together; on leaving, all are stopped, the last started first.

    They are asked with SIGTERM, once more when their patience is over, and killed only if they still do not go. Each is
    in a process group of its own, so that Ctrl-C reaches this process alone and the order of stopping stays ours.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._children: list[Child] = []

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, where: TracebackType | None
    ) -> None:
        for child in reversed(self._children):
            await self.stop(child)

    async def start(self, name: str, module: str, arguments: Sequence[str], patience_s: float = PATIENCE_S) -> Child:
        """Run `python -m module arguments`; its output goes to `<folder>/<name>.log`.

        patience_s: how long the process may take to end well when asked to.
        """
        output, command = self._folder / f"{name}.log", python_command(module, *arguments)
        child = Child(name, await _run(command, output, "wb"), output, patience_s, command)
        self._children.append(child)
        return child

    async def again(self, name: str) -> Child:
        """Run a process that has ended once more, its output after that of the first."""
        ended = self.child(name)
        process = await _run(ended.command, ended.output, "ab")
        child = Child(name, process, ended.output, ended.patience_s, ended.command)
        self._children[self._children.index(ended)] = child
        return child

    def child(self, name: str) -> Child:
        """The process of that name; KeyError."""
        return {child.name: child for child in self._children}[name]

    async def watch(self) -> None:
        """Never returns; ProcessDied, naming the first process that ends."""
        waits = {asyncio.create_task(child.process.wait()): child for child in self._children}
        try:
            done, _ = await asyncio.wait(waits, return_when=asyncio.FIRST_COMPLETED)
        finally:
            for task in waits:
                task.cancel()
        child = waits[done.pop()]
        if child.process.returncode == STARVED:
            raise ProcessDied(_last_words(child.output), starved=True)
        raise ProcessDied(f"{child.name} ended with {_status(child)}; its last words: {_last_words(child.output)}")

    async def stop(self, child: Child) -> None:
        """Ask the process to end, and kill it if it has not in time."""
        for patience_s in (child.patience_s, PATIENCE_S):
            if child.process.returncode is not None:
                return
            child.process.send_signal(signal.SIGTERM)
            try:
                await asyncio.wait_for(child.process.wait(), patience_s)
            except TimeoutError:
                continue
        if child.process.returncode is None:
            child.process.kill()
            await child.process.wait()


async def _run(command: tuple[str, ...], output: Path, mode: str) -> asyncio.subprocess.Process:
    with output.open(mode) as file:
        return await asyncio.create_subprocess_exec(
            *command,
            stdin=asyncio.subprocess.DEVNULL, stdout=file, stderr=asyncio.subprocess.STDOUT, process_group=0,
        )  # fmt: skip


def _status(child: Child) -> str:
    code = child.process.returncode or 0
    return f"signal {signal.Signals(-code).name}" if code < 0 else f"exit code {code}"


def _last_words(output: Path) -> str:
    lines = [line for line in output.read_text(errors="replace").splitlines() if line.strip()]
    return lines[-1].strip() if lines else f"none (see {output})"

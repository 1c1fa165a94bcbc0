"""Flights of real processes with a page, for who clicks on it: its own server, and a browser."""

import asyncio
import os
import subprocess
import sys
import time
import urllib.error
import urllib.request
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import asynccontextmanager, contextmanager
from pathlib import Path
from typing import TypeVar

from sim import fly
from sim.scenario import Scenario
from tests.free_ports import free_port
from tests.gcs.page.browser import browser
from wire.clock import Clock

T = TypeVar("T")


@contextmanager
def page_server(
    lab: Path, speed: float, *options: str, patience_s: float = 120.0
) -> Iterator[tuple[str, "subprocess.Popen[bytes]"]]:
    """A page that answers: its address and its process."""
    port = free_port()
    url = f"http://127.0.0.1:{port}"
    command = [sys.executable, "-m", "gcs", "page", str(lab), "--port", str(port), "--speed", str(speed), *options]
    env = {name: value for name, value in os.environ.items() if name != "PYTEST_CURRENT_TEST"}  # NiceGUI looks at it
    with (
        lab.with_name("page.log").open("wb") as log,
        subprocess.Popen(command, stdout=log, stderr=log, env=env) as process,
    ):
        try:
            end = time.monotonic() + patience_s
            while True:
                assert process.poll() is None, lab.with_name("page.log").read_text()
                assert time.monotonic() < end, "the page does not start"
                try:
                    urllib.request.urlopen(url, timeout=5.0).close()
                    break
                except (urllib.error.URLError, OSError):
                    time.sleep(0.1)
            yield url, process
        finally:
            process.kill() if process.poll() is None else None


@asynccontextmanager
async def flown(scenario: Scenario, folder: Path, speed: float) -> AsyncIterator[fly.FlightProcesses]:
    """The processes of a flight that nobody has begun to fly."""
    folder.mkdir(parents=True, exist_ok=True)
    async with fly.running(scenario, 1, fly.Files(folder), clock=Clock(speed), hosts=1) as running:
        yield running


def with_browser(
    scenario: Scenario, folder: Path, speed: float, act: Callable[[str, "subprocess.Popen[bytes]", object], T]
) -> T:
    """Have `act` use the page of a flight: it gets its address, its process, and what makes tabs."""

    def look() -> T:
        with page_server(folder / "lab.toml", speed) as (url, process), browser(folder) as tab:
            return act(url, process, tab)

    async def whole() -> T:
        async with flown(scenario, folder, speed):
            return await asyncio.to_thread(look)

    os.environ.setdefault("PYTHONPATH", os.getcwd())
    return asyncio.run(whole())

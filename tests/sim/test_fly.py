"""The operator's side of a real-time flight, against a bus of our own; and a flight's laboratory alone."""

import asyncio
import json
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, cast

import pytest

from sim.fly import operate
from sim.script import Operator
from wire.clock import Clock
from wire.transport.zenoh_bus import ZenohBus

HURRIED = Clock(1000.0)
"""A second of the flight passes in a millisecond."""


class SilentBus:
    """A bus on which the ground is not heard."""

    def on_state(self, gcs_name: str, callback: Callable[[str], None]) -> None:
        pass


def test_a_ground_that_is_slow_to_start_is_waited_for_and_it_is_said():
    said: list[tuple[float, str]] = []

    async def run() -> None:
        flight = operate(cast(ZenohBus, SilentBus()), Operator(()), 1.0, lambda *told: said.append(told), HURRIED)
        task: asyncio.Task[Any] = asyncio.create_task(flight)
        while not said or said[-1][0] < 300.0:
            await asyncio.sleep(0.0)
        assert not task.done()
        task.cancel()

    asyncio.run(run())
    assert {words for _, words in said} == {"waiting for the ground to start"}


BIN = Path(sys.executable).parent


@pytest.mark.processes
def test_a_ground_of_ones_own_finds_the_drones_of_a_practice_ready_to_arm(tmp_path: Path) -> None:
    command = [BIN / "gcs-sim", "fly", "triangle_line", "--practice", "--speed", "0.35", "--out", tmp_path]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as practice:
        assert practice.stdout is not None
        while "gcs run lab.toml" not in practice.stdout.readline():
            assert practice.poll() is None
        # Whoever practises runs both at once; here the machine may have no time for it.
        with subprocess.Popen([BIN / "gcs", "run", "lab.toml", "--speed", "0.35"], cwd=tmp_path) as ground:
            failures = None
            while failures != []:
                assert ground.poll() is None
                asked = [BIN / "gcs", "status", "--json"]
                done = subprocess.run(asked, cwd=tmp_path, capture_output=True, text=True, check=False)
                failures = json.loads(done.stdout).get("prearm_failures")
            ground.send_signal(signal.SIGINT)
        practice.send_signal(signal.SIGINT)
    assert (practice.returncode, ground.returncode) == (0, 0)

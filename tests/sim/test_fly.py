"""The operator's side of a real-time flight, against a bus of our own."""

import asyncio
from collections.abc import Callable
from typing import Any, cast

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

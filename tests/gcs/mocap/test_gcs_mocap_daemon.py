"""The mocap daemon in this process."""

import asyncio

import pytest
from gcs_bus import a_lab, hub_of

from formation.messages import Event
from gcs.mocap.daemon import Told, run
from gcs.mocap.service import ServiceError, configuration_name
from wire.clock import REAL_TIME
from wire.transport.mocap_bus import MocapBus


def test_one_that_was_left_behind_ends_when_nobody_listens():
    told: list[Event] = []
    asyncio.run(asyncio.wait_for(run(a_lab(), 0.1, Told(told.append), REAL_TIME), 60.0))
    assert told == []


def test_a_second_one_is_refused():
    async def both() -> None:
        config = a_lab()
        bus = await hub_of(config)
        MocapBus(bus).announce(configuration_name(config))
        with pytest.raises(ServiceError, match=f"serves '{config.name}' already"):
            await asyncio.wait_for(run(config, None, Told(lambda _: None), REAL_TIME), 60.0)
        await bus.close()

    asyncio.run(both())

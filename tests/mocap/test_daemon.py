"""The mocap daemon in this process."""

import asyncio

import pytest

from formation.messages import Event
from mocap.daemon import Outputs, run
from mocap.service import ServiceError, configuration_name
from tests.gcs.bus import a_lab, hub_of
from tests.wire.waiting import in_loop
from wire.clock import REAL_TIME
from wire.transport.mocap_bus import MocapBus


def test_one_that_was_left_behind_ends_when_nobody_listens():
    events: list[Event] = []
    asyncio.run(asyncio.wait_for(run(a_lab(), 0.1, Outputs(events.append), REAL_TIME), 60.0))
    assert events == []


@in_loop
async def test_a_second_mocap_process_is_rejected():
    config = a_lab()
    bus = await hub_of(config)
    MocapBus(bus).announce(configuration_name(config))
    with pytest.raises(ServiceError, match=f"serves '{config.name}' already"):
        await asyncio.wait_for(run(config, None, Outputs(lambda _: None), REAL_TIME), 60.0)
    await bus.close()

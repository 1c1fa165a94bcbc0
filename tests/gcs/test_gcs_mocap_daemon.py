"""The mocap daemon in this process."""

import asyncio
import socket

import pytest

from formation.config import LabConfig
from formation.messages import Event
from gcs.mocap.daemon import run
from gcs.mocap.service import ServiceError, configuration_name
from wire.clock import REAL_TIME
from wire.mocap_bus import MocapBus
from wire.zenoh_bus import ZenohBus


def a_lab() -> LabConfig:
    with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as probe:
        probe.bind(("127.0.0.1", 0))
        endpoint = f"tcp/127.0.0.1:{probe.getsockname()[1]}"
    return LabConfig.model_validate(
        {
            "name": "mocap-daemon",
            "leader": {"body": "lead"},
            "followers": [{"body": "left", "sysid": 2, "offset_m": (0, 1, 0)}],
            "link": {"zenoh_connect": (endpoint,)},
        }
    )


def test_one_that_was_left_behind_ends_when_nobody_listens():
    told: list[Event] = []
    asyncio.run(asyncio.wait_for(run(a_lab(), 0.1, told.append, REAL_TIME), 60.0))
    assert told == []


def test_a_second_one_is_refused():
    async def both() -> None:
        config = a_lab()
        hub = config.link.model_copy(update={"zenoh_listen": config.link.zenoh_connect, "zenoh_connect": ()})
        bus = await ZenohBus.open(hub, config.name)
        MocapBus(bus).announce(configuration_name(config))
        with pytest.raises(ServiceError, match="serves 'mocap-daemon' already"):
            await asyncio.wait_for(run(config, None, lambda _: None, REAL_TIME), 60.0)
        await bus.close()

    asyncio.run(both())

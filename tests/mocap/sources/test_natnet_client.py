"""The client and a server over real sockets of this machine."""

import asyncio
import os
import socket
from contextlib import asynccontextmanager
from typing import Any

import pytest

from formation.config import LabConfig
from formation.messages import Event, RawFrame
from mocap.sources.natnet.session import open_sockets
from mocap.sources.registry import open_source
from mocap.sources.source import Feed
from tests.free_ports import free_port
from tests.wire.waiting import in_loop
from wire.clock import REAL_TIME
from wire.rejections import RejectionLog

UNICAST: dict[str, Any] = {"interface": "127.0.0.2", "multicast": ""}
WITHIN_S = 30.0


def lab(table: dict[str, Any]) -> LabConfig:
    port = free_port(2)
    ports = {"host": "127.0.0.1", "command_port": port, "data_port": port + 1}
    follower = {"body": "left", "sysid": 2, "offset_m": (0.0, 1.0, 0.0)}
    mocap = {"source": "natnet", "natnet": ports | table}
    return LabConfig.model_validate({"mocap": mocap, "leader": {"body": "lead"}, "followers": [follower]})


class Flow:
    """A client that runs, and what came of it."""

    def __init__(self, config: LabConfig) -> None:
        self.frames: asyncio.Queue[RawFrame] = asyncio.Queue()
        self.events: list[Event] = []
        feed = Feed(config.mocap, self.frames.put_nowait, self.events.append, RejectionLog(), REAL_TIME)
        self.client = open_source(config, None, feed)  # type: ignore[arg-type]


@asynccontextmanager
async def running(config: LabConfig):
    flow = Flow(config)
    task = asyncio.ensure_future(flow.client.run())
    try:
        async with asyncio.timeout(WITHIN_S):
            yield flow, flow.client
    finally:
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)


def test_data_for_port_1511_is_taken_where_the_server_sends_it_there():
    config = lab(UNICAST).mocap.natnet
    assert config is not None
    said: list[str] = []
    with open_sockets(config, "127.0.0.1", said.append) as sockets:
        assert [each.getsockname()[0] for each in sockets] == ["127.0.0.2"] * 2
        assert sockets[1].getsockname()[1] == config.data_port
        assert sockets[0].getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF) > 200_000
        with open_sockets(config, "127.0.0.1", said.append) as others:  # the port is taken: the command socket alone
            assert len(others) == 1
    assert len(said) == 1
    assert said[0].startswith(f"UDP port {config.data_port} of the cameras' data: Address already in use: ")
    assert f"(process {os.getpid()}) has it" in said[0]


@pytest.mark.parametrize(
    ("table", "text"),
    [
        ({"interface": "203.0.113.7"}, "203.0.113.7 port 0: Cannot assign requested address"),
        ({"host": "no.such.host.invalid"}, "no.such.host.invalid: "),
    ],
)
@in_loop
async def test_an_address_that_cannot_be_used_is_reported_once_and_tried_again(table, text):
    async with running(lab(table)) as (flow, _):
        while not flow.events:
            await asyncio.sleep(0.02)
        await asyncio.sleep(0.6)
        assert len(flow.events) == 1
        assert text in flow.events[0].text
        assert flow.events[0].text.endswith("; trying again")

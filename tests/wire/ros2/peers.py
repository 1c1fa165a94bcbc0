"""A ROS 2 graph for tests: its router, and other nodes by plain Zenoh, with the keys of rmw_zenoh by hand."""

import asyncio
import json
import struct
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager, contextmanager

import zenoh

from tests.free_ports import free_port
from wire.ros2.node import Graph, Node

DOMAIN = 7
POSE = "geometry_msgs::msg::dds_::PoseStamped_/RIHS01_10f3786d7d40fd2b54367835614bff85d4ad3b5dab62bf8bca0cc232d73b4cd8"
TRIGGER = "std_srvs::srv::dds_::Trigger_/RIHS01_eeff2cd6fa5ad9d27cdf4dec64818317839b62f212a91e6b5304b634b2062c5f"
"""What ends the keys of those types in Jazzy and later."""
REQUEST = bytes((0, 1, 0, 0, 0))
"""An empty message has one byte."""
ATTACHED = struct.Struct("<qqB16s")


def opened(mode: str, endpoint: str) -> zenoh.Session:
    """A session that listens as the graph's router or as a lab's bus (a peer), or a client of it."""
    config = zenoh.Config()
    at = "connect/endpoints" if mode == "client" else "listen/endpoints"
    for key, value in {"mode": mode, at: [endpoint], "scouting/multicast/enabled": False}.items():
        config.insert_json5(key, json.dumps(value))
    return zenoh.open(config)


@contextmanager
def router() -> Iterator[str]:
    """A router, as `rmw_zenohd`; its endpoint."""
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    session = opened("router", endpoint)
    try:
        yield endpoint
    finally:
        session.close()


@asynccontextmanager
async def node(endpoint: str, namespace: str = "") -> AsyncIterator[Node]:
    """A node of ours."""
    ours = await Node.open(Graph(endpoint, DOMAIN, namespace))
    try:
        yield ours
    finally:
        await ours.close()


async def until(condition, within_s: float = 30.0) -> None:
    """Return when the condition holds."""
    async with asyncio.timeout(within_s):
        while not condition():
            await asyncio.sleep(0.01)


async def call(session: zenoh.Session, service: str, request: bytes = REQUEST) -> zenoh.Reply:
    """The answer of a service of std_srvs/srv/Trigger, once it is there."""
    attached = ATTACHED.pack(5, 1_700_000_000_000_000_000, 16, bytes(range(16)))
    key = f"{DOMAIN}{service}/{TRIGGER}"
    async with asyncio.timeout(30.0):
        while True:
            replies = await asyncio.to_thread(
                lambda: list(session.get(key, payload=request, attachment=attached, timeout=5.0))
            )
            if replies:
                return replies[0]
            await asyncio.sleep(0.05)

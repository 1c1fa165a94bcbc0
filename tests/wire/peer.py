"""One process on the bus, for tests that kill it: `wire_peer.py mocap|drone PORT`."""

import asyncio
import itertools
import sys

import numpy as np

from formation.config import LinkConfig
from formation.messages import Datagram, LabFrame
from wire.clock import monotonic_ns
from wire.transport.mocap_bus import MocapBus
from wire.transport.zenoh_bus import ZenohBus


async def mocap(port: str) -> None:
    """Listen, and publish frames."""
    bus = await ZenohBus.open(LinkConfig(zenoh_listen=(f"tcp/127.0.0.1:{port}",)), "lab")
    mocap = MocapBus(bus)
    for seq in itertools.count():
        frame = LabFrame(seq, monotonic_ns(), ("a",), np.zeros((1, 3)), np.eye(1, 4), np.ones(1, bool))
        mocap.publish_frame(frame)
        await asyncio.sleep(0.01)


async def drone(port: str) -> None:
    """Connect, and send every packet back."""
    bus = await ZenohBus.open(LinkConfig(zenoh_connect=(f"tcp/127.0.0.1:{port}",)), "lab")
    link = bus.drone_link(2, lambda datagram: link.send(Datagram(2, datagram.data)))
    await asyncio.Event().wait()


if __name__ == "__main__":
    asyncio.run({"mocap": mocap, "drone": drone}[sys.argv[1]](sys.argv[2]))

"""A simulated drone's daemon in real time, over UDP and over the bus: what its guard refuses."""

import asyncio
import os
import re
import signal

import numpy as np
import pytest

from drone_agent.config import SimulatedDroneConfig
from drone_agent.daemon import run
from formation.config import LabConfig
from formation.messages import Datagram
from gcs.drones.links import open_links
from tests.drone_agent.agent_harness import LEVEL
from tests.free_ports import free_port
from wire.link_messages import (
    GROUND,
    Address,
    AttitudeSetpoint,
    Ignore,
    StatusText,
)
from wire.mavlink.codec import Codec
from wire.transport.zenoh_bus import ZenohBus

pytestmark = pytest.mark.processes
SYSID = 3


def _lab(kind: str) -> LabConfig:
    end = f"tcp/127.0.0.1:{free_port()}"
    return LabConfig.model_validate(
        {
            "name": f"rates-{os.getpid()}-{kind}",
            "leader": {"body": "lead"},
            "followers": [{"body": "left", "sysid": SYSID, "offset_m": (0, 1, 0)}],
            "link": {
                "kind": kind, "zenoh_listen": (end,), "zenoh_connect": (end,),
                "ground_port_base": free_port() - SYSID, "drone_port_base": free_port() - SYSID,
            },
        }
    )  # fmt: skip


@pytest.mark.parametrize("kind", ["udp", "zenoh"])
def test_body_rates_beyond_the_vehicles_are_refused_and_counted(kind: str) -> None:
    """That the drone does not turn by them is shown in lockstep (tests/drone_agent/test_refusals.py)."""
    texts = asyncio.run(_refused(_lab(kind)))
    assert re.fullmatch(r"refused: \d+ x setpoint beyond the vehicle's body rates \(from .*\)", texts[-1])


async def _refused(lab: LabConfig) -> list[str]:
    """The drone's texts until it has refused something."""
    texts: list[str] = []
    codec, refused = Codec(GROUND), asyncio.Event()

    def receive(datagram: Datagram) -> None:
        for packet in codec.receive(datagram.data):
            if isinstance(packet.message, StatusText) and not refused.is_set():
                texts.append(packet.message.text)
                if "refused" in texts[-1]:
                    refused.set()

    rate = np.array([100.0, 0.0, 0.0])
    setpoint = codec.encode(AttitudeSetpoint(Address(SYSID, 1), 0, LEVEL, rate, 1.0, Ignore.NONE))
    bus = await ZenohBus.open(lab.link.listening, lab.name)
    links = await open_links(lab, bus, receive)
    config = SimulatedDroneConfig(
        sysid=SYSID, lab=lab.name, body="left", link=lab.link.joined, profile="px4_quad", pose="mocap"
    )
    daemon = asyncio.create_task(run([config], lambda _: None))
    try:
        async with asyncio.timeout(60.0):
            while not refused.is_set():
                links.send(Datagram(SYSID, setpoint))
                await asyncio.sleep(0.02)
    finally:
        os.kill(os.getpid(), signal.SIGINT)
        await asyncio.wait_for(daemon, 30.0)
        links.close()
        await bus.close()
    return texts

"""The sockets of one UDP port: the peer's packets survive a flood of others, and nobody else shares the port."""

import asyncio
import socket
from collections.abc import Iterator

import pytest
import uvloop

from formation.config import LinkConfig
from formation.messages import Datagram
from tests.free_ports import free_port
from wire.link_messages import Address, Heartbeat, MavAutopilot, MavState, MavType
from wire.mavlink.codec import Codec
from wire.rejections import RejectionLog
from wire.transport.udp_bus import bind_port, open_udp_drone, open_udp_ground

LOOPBACK = "127.0.0.1"
FLOOD = 50_000
"""Datagrams: a kernel's buffer of the default size holds a few hundred."""


@pytest.fixture
def peer() -> Iterator[socket.socket]:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as end:
        end.bind((LOOPBACK, free_port()))
        yield end


def flood(port: int) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
        for _ in range(FLOOD):
            stranger.sendto(bytes(60), (LOOPBACK, port))


@pytest.mark.parametrize("shares", [False, True])
def test_nobody_else_binds_the_port(shares: bool, peer: socket.socket) -> None:
    port = free_port()
    sockets = bind_port((LOOPBACK, port), peer.getsockname())
    try:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
            other.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEPORT, int(shares))
            with pytest.raises(OSError, match="in use"):
                other.bind((LOOPBACK, port))
        with pytest.raises(OSError, match="in use"):
            bind_port((LOOPBACK, port), peer.getsockname())
    finally:
        sockets.close()


def test_a_link_delivers_every_packet_of_its_drone_beside_a_flood(peer: socket.socket) -> None:
    """A byte behind each packet, so that no newer one supersedes it; all wait in the kernel before one is read."""
    beat = Heartbeat(MavAutopilot.PX4, MavType.QUADROTOR, 0, 0, MavState.STANDBY)
    packets = [Codec(Address(1, 1)).encode(beat) + bytes((0xFF,)) for _ in range(200)]
    drone_port, ground_port = peer.getsockname()[1], free_port()
    links = LinkConfig(kind="udp", ground_port_base=ground_port - 1, drone_port_base=drone_port - 1)

    async def receive() -> list[Datagram]:
        delivered: list[Datagram] = []
        done = asyncio.Event()

        def deliver(datagram: Datagram) -> None:
            delivered.append(datagram)
            if len(delivered) == len(packets):
                done.set()

        link = await open_udp_ground(links, (1,), deliver, RejectionLog())
        for packet in packets[:100]:
            peer.sendto(packet, (LOOPBACK, ground_port))
        flood(ground_port)
        for packet in packets[100:]:
            peer.sendto(packet, (LOOPBACK, ground_port))
        async with asyncio.timeout(30.0):
            await done.wait()
        link.close()
        return delivered

    assert [each.data for each in asyncio.run(receive())] == packets


@pytest.mark.parametrize("run", [asyncio.run, uvloop.run])
def test_a_drone_that_spoke_before_its_ground_was_there_hears_it_later(run) -> None:
    """What it sent comes back as an ICMP error, which must not end the hearing; on the loop of the programs, too."""
    beat = Codec(Address(255, 190)).encode(Heartbeat(MavAutopilot.INVALID, MavType.GCS, 0, 0, MavState.ACTIVE))
    drone_port, ground_port = free_port(), free_port()
    links = LinkConfig(kind="udp", ground_port_base=ground_port - 1, drone_port_base=drone_port - 1)

    async def speak() -> bytes:
        heard: asyncio.Queue[Datagram] = asyncio.Queue()
        drone = await open_udp_drone(links, 1, heard.put_nowait, RejectionLog())
        for _ in range(3):
            drone.send(Datagram(1, beat))
            await asyncio.sleep(0.02)  # the loop sees the error
        ground = await open_udp_ground(links, (1,), lambda _: None, RejectionLog())
        ground.send(Datagram(1, beat))
        try:
            async with asyncio.timeout(10.0):
                return (await heard.get()).data
        finally:
            drone.close()
            ground.close()

    assert run(speak()) == beat

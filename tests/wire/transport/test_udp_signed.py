"""Signed UDP links over real sockets: peers are learnt from verified packets only."""

import asyncio
import socket
from pathlib import Path

import pytest

from formation.messages import Datagram
from tests.free_ports import free_port
from tests.wire.transport.test_udp_bus import Mailbox, client, config
from tests.wire.waiting import in_loop, until
from wire import clock
from wire.link_messages import GROUND, Address, Heartbeat, MavAutopilot
from wire.mavlink.codec import Codec
from wire.mavlink.signing import UNSIGNED, WRONG, SigningChannel, StampClock
from wire.rejections import RejectionLog
from wire.security.private_keys import StampFile
from wire.security.protection import Protection, Signing
from wire.transport.udp_bus import open_udp_direct, open_udp_drone, open_udp_ground

KEY, OTHER_KEY = bytes(range(32)), bytes(32)
BEAT = Codec(Address(1, 1)).encode(Heartbeat(MavAutopilot.PX4, 2, 0, 0, 4))
FLOOD = 500


def signed(folder: Path, at_ground: bool, key: bytes = KEY) -> Protection:
    """One end's protection, its stamps in the folder."""
    stamps = StampFile(folder / f"stamp-{at_ground}")
    return Protection(signing=Signing({1: key}, StampClock(stamps.read()), stamps, at_ground))


def drone(key: bytes = KEY) -> SigningChannel:
    """The drone's end of a client's socket."""
    return SigningChannel(key, StampClock(), (1).__ne__)


@pytest.mark.parametrize("forge", ["unsigned", "other key"])
@in_loop
async def test_a_stranger_who_speaks_first_gets_nothing(forge: str, tmp_path: Path) -> None:
    """`udpin:`, where the first to speak was the drone: the drone is, whoever spoke before."""
    port, got, rejections = free_port(), Mailbox(), RejectionLog()
    link = await open_udp_direct(f"udpin:127.0.0.1:{port}", 1, got, rejections, signed(tmp_path, True))
    stranger, true = client(), client()
    other = drone(OTHER_KEY)
    for _ in range(FLOOD):
        data = BEAT if forge == "unsigned" else other.sign(BEAT, clock.unix_us())
        stranger.sendto(data, ("127.0.0.1", port))
    channel = drone()
    await until(got.event, lambda: true.sendto(channel.sign(BEAT, clock.unix_us()), ("127.0.0.1", port)))
    down = Codec(GROUND).encode(Heartbeat(MavAutopilot.INVALID, 6, 0, 0, 4))
    for _ in range(50):
        link.send(Datagram(1, down))
    await asyncio.sleep(0)
    with pytest.raises(BlockingIOError):
        stranger.recv(2048)
    assert channel.verify(true.recv(2048), clock.unix_us()).data
    assert all(datagram.data[2] == 1 for datagram in got.got)
    assert rejections.count >= 1
    (event,) = rejections.due(clock.monotonic_ns())
    assert (UNSIGNED if forge == "unsigned" else WRONG) in event.text
    for each in (stranger, true):
        each.close()
    link.close()


@in_loop
async def test_a_stranger_does_not_take_the_place_of_a_silent_drone(tmp_path: Path) -> None:
    """A second of silence lets another address in only with a verified packet."""
    port, got = free_port(), Mailbox()
    link = await open_udp_direct(f"udpin:127.0.0.1:{port}", 1, got, RejectionLog(), signed(tmp_path, True))
    true, stranger, channel = client(), client(), drone()
    await until(got.event, lambda: true.sendto(channel.sign(BEAT, clock.unix_us()), ("127.0.0.1", port)))
    recorded = channel.sign(BEAT, clock.unix_us())
    got.event.clear()
    await until(got.event, lambda: true.sendto(recorded, ("127.0.0.1", port)))
    await asyncio.sleep(1.1)
    before = len(got.got)
    for data in (BEAT, recorded, drone(OTHER_KEY).sign(BEAT, clock.unix_us())):
        stranger.sendto(data, ("127.0.0.1", port))
    await asyncio.sleep(0.2)
    assert len(got.got) == before
    link.send(Datagram(1, Codec(GROUND).encode(Heartbeat(MavAutopilot.INVALID, 6, 0, 0, 4))))
    with pytest.raises(BlockingIOError):
        stranger.recv(2048)
    for each in (stranger, true):
        each.close()
    link.close()


@in_loop
async def test_forged_packets_supersede_no_telemetry(tmp_path: Path) -> None:
    """Newer packets of a stream replace older ones that wait: a forged one is gone before it could."""
    settings, got = config(), Mailbox()
    link = await open_udp_ground(settings, [1], got, RejectionLog(), signed(tmp_path, True))
    address = ("127.0.0.1", settings.ground_port_base + 1)
    true = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    true.bind(("127.0.0.1", settings.drone_port_base + 1))
    true.sendto(drone().sign(BEAT, clock.unix_us()), address)
    for _ in range(20):
        true.sendto(BEAT, address)  # from the drone's own address: its source is spoofed
    await until(got.event)
    assert [datagram.data[2] for datagram in got.got] == [1]
    assert got.got[0].superseded == 0
    true.close()
    link.close()


@in_loop
async def test_a_drones_end_sends_nothing_to_unverified_talkers(tmp_path: Path) -> None:
    settings, got = config(), Mailbox()
    link = await open_udp_drone(settings, 1, got, RejectionLog(), signed(tmp_path, False))
    stranger = client()
    for _ in range(FLOOD):
        stranger.sendto(
            Codec(GROUND).encode(Heartbeat(MavAutopilot.INVALID, 6, 0, 0, 4)),
            ("127.0.0.1", settings.drone_port_base + 1),
        )
    await asyncio.sleep(0.3)
    link.send(Datagram(1, BEAT))
    with pytest.raises(BlockingIOError):
        stranger.recv(2048)
    assert got.got == []
    stranger.close()
    link.close()

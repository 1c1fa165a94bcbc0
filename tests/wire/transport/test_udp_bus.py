"""UDP links over real sockets on loopback."""

import asyncio
import socket
import time

import numpy as np
import pytest

from formation.config import LinkConfig
from formation.maths.frames import IDENTITY
from formation.messages import Datagram
from tests.free_ports import free_port
from tests.wire.waiting import in_loop, until
from wire import clock
from wire.link_messages import (
    GROUND,
    Address,
    AttitudeQuaternion,
    CommandAck,
    Heartbeat,
    MavAutopilot,
    MavCommand,
    Result,
)
from wire.mavlink.codec import Codec
from wire.rejections import RejectionLog
from wire.transport.link import TURN_NS
from wire.transport.udp_bus import open_udp_direct, open_udp_drone, open_udp_ground

BEAT = Heartbeat(MavAutopilot.PX4, 2, 0, 0, 4)


def config() -> LinkConfig:
    """Bases under which the ports of drones 1 and 2 are free."""
    return LinkConfig(kind="udp", ground_port_base=free_port(2) - 1, drone_port_base=free_port(2) - 1)


class Mailbox:
    """What a link has delivered, and an event for the first of it."""

    def __init__(self) -> None:
        self.got: list[Datagram] = []
        self.event = asyncio.Event()

    def __call__(self, datagram: Datagram) -> None:
        self.got.append(datagram)
        self.event.set()


def client() -> socket.socket:
    """Somebody else's MAVLink program: a socket of its own."""
    sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    sock.bind(("127.0.0.1", 0))
    sock.setblocking(False)
    return sock


@in_loop
async def test_ground_and_drones_hear_each_other_and_nobody_else():
    settings = config()
    at_ground, at_one, at_two = Mailbox(), Mailbox(), Mailbox()
    ground = await open_udp_ground(settings, [1, 2], at_ground, RejectionLog())
    one = await open_udp_drone(settings, 1, at_one, RejectionLog())
    two = await open_udp_drone(settings, 2, at_two, RejectionLog())
    ground.send(Datagram(1, b"\xfdfor one"))
    ground.send(Datagram(2, b"\xfdfor two"))
    await until(at_one.event)
    await until(at_two.event)
    two.send(Datagram(2, b"\xfdfrom two"))
    await until(at_ground.event)
    assert at_one.got == [Datagram(1, b"\xfdfor one")]
    assert at_two.got == [Datagram(2, b"\xfdfor two")]
    assert at_ground.got == [Datagram(2, b"\xfdfrom two")]
    assert (ground.counters.sent, ground.counters.received, ground.counters.dropped) == (2, 1, 0)
    with pytest.raises(KeyError):
        ground.send(Datagram(9, b""))
    for link in (ground, one, two):
        link.close()


@in_loop
async def test_a_drone_is_not_led_astray_by_noise_or_by_many_senders():
    settings = config()
    at_drone = Mailbox()
    drone = await open_udp_drone(settings, 1, at_drone, RejectionLog())
    loop = asyncio.get_running_loop()
    others = [client() for _ in range(6)]
    for i, other in enumerate(others):
        words = b"no MAVLink" if i == 5 else b"\xfd"
        await loop.sock_sendto(other, words, ("127.0.0.1", settings.drone_port_base + 1))
    heard = asyncio.Event()
    await until(heard, lambda: heard.set() if len(at_drone.got) == 6 else None)
    drone.send(Datagram(1, b"\xfdtelemetry"))
    for other in others[1:5]:
        assert await asyncio.wait_for(loop.sock_recv(other, 2048), 10.0) == b"\xfdtelemetry"
    assert drone.counters.sent == 1 + 4
    for other in (others[0], others[5]):
        with pytest.raises(BlockingIOError):
            other.recv(2048)
    for other in others:
        other.close()
    drone.close()


@in_loop
async def test_a_taken_port_is_an_oserror_and_leaves_nothing_open():
    settings = config()
    ground = await open_udp_ground(settings, [2], lambda _: None, RejectionLog())
    with pytest.raises(OSError, match="in use"):
        await open_udp_ground(settings, [1, 2], lambda _: None, RejectionLog())
    again = await open_udp_ground(settings, [1], lambda _: None, RejectionLog())
    ground.close()
    again.close()


@in_loop
async def test_an_autopilots_own_port_that_is_listened_on():
    """ArduPilot sends from a port of its choosing: the answer goes to where it last sent from."""
    port = free_port()
    at_ground = Mailbox()
    link = await open_udp_direct(f"udpin:127.0.0.1:{port}", 4, at_ground, RejectionLog())
    loop = asyncio.get_running_loop()
    link.send(Datagram(4, b"\xfdnobody yet"))
    assert link.counters.sent == 0
    beat = Codec(Address(4, 1)).encode(BEAT)
    for _ in range(2):  # the second stands for a restart, which takes a second at least
        with client() as autopilot:
            at_ground.event.clear()
            await until(at_ground.event, lambda a=autopilot: a.sendto(beat, ("127.0.0.1", port)))
            link.send(Datagram(4, b"\xfdsetpoint"))
            assert await asyncio.wait_for(loop.sock_recv(autopilot, 2048), 10.0) == b"\xfdsetpoint"
    assert set(at_ground.got) == {Datagram(4, beat)}
    link.close()


STRAYS = (b"\xfe" * 1500, b"\xfd" * 1500, b"", b"no MAVLink", Codec(Address(9, 1)).encode(BEAT), bytes(60_000))


@pytest.mark.parametrize("kind", ["shared", "udpout", "udpin"])
@in_loop
async def test_a_drone_is_heard_and_answered_among_any_strays(kind):
    """Strays reach nobody, are told of with their sender, and lead no setpoint astray."""
    settings = config()
    at_ground, rejections = Mailbox(), RejectionLog()
    with client() as drone, client() as stranger:
        own = drone.getsockname()[1]
        if kind == "shared":
            settings = settings.model_copy(update={"drone_port_base": own - 1})
            link = await open_udp_ground(settings, [1], at_ground, rejections)
            port = settings.ground_port_base + 1
        elif kind == "udpout":
            link = await open_udp_direct(f"udpout:127.0.0.1:{own}", 1, at_ground, rejections)
            link.send(Datagram(1, b"\xfdhello"))
            _, (_, port) = await asyncio.wait_for(asyncio.get_running_loop().sock_recvfrom(drone, 2048), 10.0)
        else:
            port = free_port()
            link = await open_udp_direct(f"udpin:127.0.0.1:{port}", 1, at_ground, rejections)
        coder = Codec(Address(1, 1))
        beats = [coder.encode(BEAT) for _ in range(50)]
        for beat in beats:
            at_ground.event.clear()
            drone.sendto(beat, ("127.0.0.1", port))
            await until(at_ground.event)
            for stray in STRAYS:
                stranger.sendto(stray, ("127.0.0.1", port))
        last = asyncio.Event()
        await until(last, lambda: last.set() if rejections.count == len(STRAYS) * len(beats) else None)
        assert [datagram.data for datagram in at_ground.got] == beats
        assert rejections.count == link.counters.rejected == len(STRAYS) * len(beats)
        assert {event.source for event in rejections.due(0)} == {"127.0.0.1"}
        link.send(Datagram(1, b"\xfdsetpoint"))
        assert await asyncio.wait_for(asyncio.get_running_loop().sock_recv(drone, 2048), 10.0) == b"\xfdsetpoint"
        link.close()


@in_loop
async def test_a_flood_leaves_the_others_their_turn_after_a_bound_of_work():
    """A tick that is due comes before a flood's next datagrams: a millisecond of work, then everybody else's turn."""
    settings = config()
    turns: list[str] = []

    def work(_: Datagram) -> None:
        turns.append("read")
        end_ns = clock.cpu_ns() + TURN_NS // 4
        while clock.cpu_ns() < end_ns:
            pass

    ground = await open_udp_ground(settings, [1], work, RejectionLog())
    drone = await open_udp_drone(settings, 1, lambda _: None, RejectionLog())
    for _ in range(100):
        drone.send(Datagram(1, b"\xfd" * 100))
    loop = asyncio.get_running_loop()

    def tick() -> None:
        turns.append("tick")
        if turns.count("read") < 100:
            loop.call_soon(tick)

    tick()
    done = asyncio.Event()
    await until(done, lambda: done.set() if turns.count("read") == 100 else None)
    words = "".join("r" if turn == "read" else "t" for turn in turns)
    assert max(map(len, words.split("t"))) <= 4
    ground.close()
    drone.close()


@in_loop
async def test_a_link_that_got_its_turn_late_goes_on_with_what_is_new():
    """Half a second of a PX4's telemetry waits in the kernel, every turn of the loop is long: a few turns deliver the
    newest, no acknowledgement is lost, and what was dropped is counted."""
    settings, coder = config(), Codec(Address(1, 1))
    got: list[Datagram] = []
    ground = await open_udp_ground(settings, [1], got.append, RejectionLog())
    drone = await open_udp_drone(settings, 1, lambda _: None, RejectionLog())
    sent = [AttitudeQuaternion(ms, IDENTITY, np.zeros(3)) for ms in range(200)]
    for k, message in enumerate(sent):
        drone.send(Datagram(1, coder.encode(message)))
        if k == 50:
            ack = coder.encode(CommandAck(GROUND, MavCommand.NAV_LAND, Result.ACCEPTED))
            drone.send(Datagram(1, ack))
    for _ in range(5):
        time.sleep(0.02)
        await asyncio.sleep(0)
    read = [packet for datagram in got for packet in Codec(GROUND).receive(datagram.data)]
    assert read[-1].message.t_boot_ms == 199
    assert any(isinstance(packet.message, CommandAck) for packet in read)
    assert len(got) + ground.counters.superseded == len(sent) + 1
    assert sum(datagram.superseded for datagram in got) == ground.counters.superseded > 150
    ground.close()
    drone.close()


@in_loop
async def test_an_autopilot_that_answers_its_first_sender_for_ever_hears_the_next_run_too():
    loop = asyncio.get_running_loop()
    with client() as autopilot:
        senders = set()
        for _ in range(2):
            link = await open_udp_direct(
                f"udp:127.0.0.1:{autopilot.getsockname()[1]}", 249, lambda _: None, RejectionLog()
            )
            link.send(Datagram(249, b"\xfdhello"))
            senders.add((await asyncio.wait_for(loop.sock_recvfrom(autopilot, 2048), 10.0))[1])
            link.close()
        assert len(senders) == 1


@in_loop
async def test_two_at_once_are_no_error():
    links = [await open_udp_direct("udp:127.0.0.1:9", 248, lambda _: None, RejectionLog()) for _ in range(2)]
    for link in links:
        link.close()


@pytest.mark.parametrize(
    "link", ["", "udp", "udp:127.0.0.1", "udp:127.0.0.1:0", "udp::14540", "tcp:a:1", "udp:a:99999"]
)
def test_what_is_no_link_is_refused_in_words(link):
    with pytest.raises(ValueError, match="udpin:HOST:PORT"):
        asyncio.run(open_udp_direct(link, 1, lambda _: None, RejectionLog()))

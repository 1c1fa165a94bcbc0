"""The bridge as a process, between a Zenoh ground with its mocap and an autopilot process on UDP."""

import asyncio
import contextlib
import signal
import subprocess
import sys
from collections.abc import AsyncIterator, Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from formation.config import LinkConfig
from formation.messages import Datagram, LabFrame
from tests.conformance.agent import START_S, agent
from tests.free_ports import free_port
from wire.clock import monotonic_ns
from wire.link_messages import (
    GROUND,
    Address,
    AttitudeSetpoint,
    CommandAck,
    CommandLong,
    Heartbeat,
    Ignore,
    LinkMessage,
    NamedValue,
    StatusText,
    TimeSync,
)
from wire.mavlink.codec import Codec
from wire.transport.mocap_bus import MocapBus
from wire.transport.zenoh_bus import ZenohBus

pytestmark = pytest.mark.processes
TARGET = Address(5, 1)
LEVEL = np.array([1.0, 0.0, 0.0, 0.0])


class Ground:
    """A ground and a mocap that sees the drone stand still, both on the bus."""

    def __init__(self, bus: ZenohBus) -> None:
        self._bus = bus
        self._codec = Codec(GROUND)
        self.heard: list[LinkMessage] = []
        self._news = asyncio.Event()
        self._link = bus.ground_link([5], self._take)
        self._mocap = MocapBus(bus)
        self.thrust: float | None = None

    def _take(self, datagram: Datagram) -> None:
        for packet in self._codec.receive(datagram.data):
            self.heard.append(packet.message)
            if isinstance(packet.message, TimeSync) and packet.message.tc1_ns == 0:
                self.say(TimeSync(monotonic_ns(), packet.message.ts1_ns, packet.source))
        self._news.set()

    def say(self, message: LinkMessage) -> None:
        self._link.send(Datagram(5, self._codec.encode(message)))

    async def play(self) -> None:
        """Frames, and setpoints while `thrust` is set, at 50 Hz, until cancelled."""
        for seq in range(1_000_000):
            now_ns = monotonic_ns()
            pos = np.array([[0.1, 0.2, 0.0]])
            self._mocap.publish_frame(LabFrame(seq, now_ns, ("uav5",), pos, LEVEL[None], np.array([True])))
            if self.thrust is not None:
                ms = now_ns // 1_000_000
                self.say(AttitudeSetpoint(TARGET, ms, LEVEL, np.zeros(3), self.thrust, Ignore.BODY_RATES))
            await asyncio.sleep(0.02)

    async def first(self, wanted: Callable[[LinkMessage], bool], wait_s: float = START_S) -> LinkMessage:
        """The first message from now on that is wanted; TimeoutError."""
        start = len(self.heard)
        async with asyncio.timeout(wait_s):
            while True:
                for message in self.heard[start:]:
                    if wanted(message):
                        return message
                start = len(self.heard)
                self._news.clear()
                await self._news.wait()

    async def command(self, number: int, *params: float) -> int:
        p1, p2, p3, p4, p5, p6, p7 = (*params, *(0.0,) * (7 - len(params)))
        waiting = asyncio.create_task(self.first(lambda m: isinstance(m, CommandAck) and m.command == number))
        await asyncio.sleep(0)
        self.say(CommandLong(TARGET, number, (p1, p2, p3, p4, p5, p6, p7)))
        ack = await waiting
        assert isinstance(ack, CommandAck)
        return int(ack.result)


@contextlib.contextmanager
def bridge(folder: Path, autopilot_port: int, bus_port: int) -> Iterator[None]:
    """The bridge's process, ended cleanly."""
    config = folder / "bridge.toml"
    config.write_text(f"[link]\nzenoh_connect = ['tcp/127.0.0.1:{bus_port}']\n")
    command = [
        sys.executable, "-m", "drone_agent", "--config", str(config), "--sysid", "5", "--link", "zenoh",
        "--bridge", f"udp:127.0.0.1:{autopilot_port}",
    ]  # fmt: skip
    with (folder / "bridge.log").open("wb") as log:
        process = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=log, stderr=log)
        try:
            yield
            assert process.poll() is None, (folder / "bridge.log").read_text()
        finally:
            process.send_signal(signal.SIGTERM)
            code = process.wait(10.0)
    assert code == 0, (folder / "bridge.log").read_text()


@contextlib.asynccontextmanager
async def ground(bus_port: int) -> AsyncIterator[Ground]:
    endpoint = (f"tcp/127.0.0.1:{bus_port}",)
    bus = await ZenohBus.open(LinkConfig(zenoh_listen=endpoint, zenoh_connect=endpoint), "lab")
    opened = Ground(bus)
    playing = asyncio.create_task(opened.play())
    try:
        yield opened
    finally:
        playing.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await playing
        await bus.close()


def test_an_autopilot_is_armed_watched_and_landed_through_the_bridge(tmp_path: Path) -> None:
    async def flight(bus_port: int) -> None:
        async with ground(bus_port) as us:
            # Ready: it has its pose, and only the bridge gives it one.
            await us.first(lambda m: isinstance(m, Heartbeat) and m.system_status == 3)
            us.thrust = 0.0
            await us.first(lambda m: isinstance(m, NamedValue) and m.name == "age_ms" and m.value < 1000.0)
            assert await us.command(176, 1.0, 6.0) == 0
            assert await us.command(400, 1.0) == 0
            await us.first(lambda m: isinstance(m, Heartbeat) and m.armed)
            us.thrust = None
            await us.first(lambda m: isinstance(m, StatusText) and "stale: level and hold" in m.text)
            await us.first(lambda m: isinstance(m, StatusText) and "stale: landing" in m.text)
            # On the floor the bridge asks for landing and disarming at once: the mode between may last a millisecond.
            await us.first(lambda m: isinstance(m, Heartbeat) and not m.armed)

    bus_port = free_port()
    keys = "pose = 'mocap'\nstale_setpoint_s = 0\nparameters = { COM_OF_LOSS_T = 5 }"
    with (
        agent(tmp_path, keys, sysid=5) as autopilot,
        bridge(tmp_path, autopilot.drone_port, bus_port),
    ):
        asyncio.run(flight(bus_port))

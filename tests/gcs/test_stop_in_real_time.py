"""The ground's daemon and a simulated drone in real time, over UDP and over the bus: a stop among few frames."""

import asyncio
import gc
import os
from itertools import count
from pathlib import Path
from typing import cast

import numpy as np
import pytest

from drone_agent.config import SimulatedDroneConfig
from drone_agent.core import AgentCore
from drone_agent.daemon import _Pump
from drone_agent.process import open_ground_link
from formation import topics
from formation.config import LabConfig
from formation.maths.frames import IDENTITY
from formation.messages import Datagram, Event, LabFrame, OperatorRequest, Phase, Verb
from gcs.daemon import run
from mocap.service import configuration_name
from tests.free_ports import free_port
from wire.clock import REAL_TIME
from wire.config_file import dump
from wire.ground_state import GroundState, decode
from wire.link_messages import GROUND, CommandAck, MavCommand, MessageId, Result
from wire.logs.mcap_read import read_log
from wire.mavlink.codec import Codec
from wire.mavlink.framing import FrameCutter
from wire.rejections import RejectionLog
from wire.security.protection import LOOPBACK_ONLY
from wire.transport.link import Link, LinkCounters
from wire.transport.mocap_bus import MocapBus
from wire.transport.zenoh_bus import ZenohBus

pytestmark = pytest.mark.processes

SYSID = 2
MUTE_S = 0.5


class _Between:
    """The drone's end of its link: counts motor cuts, answers each at once, and can withhold the drone's heartbeats."""

    def __init__(self, link: Link, codec: Codec) -> None:
        self._link, self._codec, self._cutter = link, codec, FrameCutter()
        self.counters = LinkCounters()
        self.cuts, self.mute = 0, False
        self.cut = asyncio.Event()

    def send(self, datagram: Datagram) -> None:
        frames = list(self._cutter.cut(datagram.data))
        kept = [frame.data for frame in frames if not (self.mute and frame.number == MessageId.HEARTBEAT)]
        if kept:
            self._link.send(Datagram(datagram.sysid, b"".join(kept)))

    def note(self, datagram: Datagram) -> None:
        """Count the cuts that the ground sends; each is acknowledged, as a late answer to `arm` would be."""
        for packet in self._codec.receive(datagram.data):
            command = packet.message
            if getattr(command, "command", None) == MavCommand.COMPONENT_ARM_DISARM:
                self.cuts += 1
                self.cut.set()
                self._link.send(Datagram(SYSID, self._codec.encode(CommandAck(GROUND, 400, Result.ACCEPTED))))

    def close(self) -> None:
        self._link.close()


def _lab(kind: str) -> LabConfig:
    """Frames twice a second: whatever waits for one, or for one that is overdue, waits for half a second or more."""
    port = free_port()
    return LabConfig.model_validate(
        {
            "name": f"stop-{os.getpid()}-{kind}",
            "mocap": {"rate_hz": 2.0},
            "leader": {"body": "lead"},
            "followers": [{"body": "left", "sysid": SYSID, "offset_m": (0, 1, 0)}],
            "link": {
                "kind": kind,
                "zenoh_connect": (f"tcp/127.0.0.1:{port}",),
                "ground_port_base": free_port() - SYSID,
                "drone_port_base": free_port() - SYSID,
            },
        }
    )


async def _frames(config: LabConfig, bus: MocapBus) -> None:
    """The mocap process: the leader and the drone, standing."""
    bus.announce(configuration_name(config))
    for seq in count():
        pos_lab_m, q = np.array([[0.0, 0.0, 0.0], [0.0, 1.0, 0.0]]), np.tile(IDENTITY, (2, 1))
        now_ns = REAL_TIME.monotonic_ns()
        bus.publish_frame(LabFrame(seq, now_ns, ("lead", "left"), pos_lab_m, q, np.ones(2, np.bool_)))
        await asyncio.sleep(1.0 / config.mocap.rate_hz)


async def _library() -> None:
    raise RuntimeError("of a library")


class _Flight:
    """What the operator's end of the bus sees."""

    def __init__(self, bus: ZenohBus) -> None:
        self.bus, self.state = bus, cast(GroundState, None)
        self.events: list[Event] = []
        bus.on_state("main", self._receive)

    def _receive(self, text: str) -> None:
        self.state = decode(text)

    async def until(self, holds) -> None:
        async with asyncio.timeout(30.0):
            while self.state is None or not holds(self.state):
                await asyncio.sleep(0.01)


@pytest.mark.parametrize("kind", ["udp", "zenoh"])
def test_a_stop_is_repeated_until_the_drone_says_so_whatever_else_fails(kind: str, tmp_path: Path) -> None:
    asyncio.run(_stopped(_lab(kind), tmp_path))


async def _stopped(config: LabConfig, folder: Path) -> None:
    lab_file, log, events = folder / "lab.toml", folder / "flight.mcap", []
    lab_file.write_text(dump(config))
    bus = await ZenohBus.open(config.link.listening, config.name)
    frames = asyncio.create_task(_frames(config, MocapBus(bus)))
    ground = asyncio.create_task(run(config, lab_file, log, "main", {}, events.append))
    flight = _Flight(bus)
    drone = SimulatedDroneConfig(sysid=SYSID, lab=config.name, link=config.link, guard=False)
    pump = _Pump(drone, AgentCore(drone, REAL_TIME.monotonic_ns()), lambda _: None, REAL_TIME, RejectionLog())

    def receive(datagram: Datagram) -> None:
        between.note(datagram)
        pump.receive(datagram)

    link = await open_ground_link(drone, bus, receive, RejectionLog(), LOOPBACK_ONLY)
    between = pump.link = _Between(link, Codec(GROUND.__class__(SYSID, 1)))
    try:
        await flight.until(lambda _state: True)
        pump.turn()
        await flight.until(lambda state: state.drones[0].autopilot is not None and state.counters.frames > 2)
        asyncio.create_task(_library())  # noqa: RUF006 - nobody keeps or awaits it
        await asyncio.sleep(0.05)
        gc.collect()
        between.mute = True
        reply = asyncio.create_task(bus.ask("main", OperatorRequest(1, Verb.STOP), 10.0))
        await asyncio.wait_for(between.cut.wait(), 10.0)
        await asyncio.sleep(MUTE_S)
        heard, stopped_ms = between.cuts, flight.state.drones[0].stopped_ms
        between.mute = False
        assert (await reply).accepted
        await flight.until(lambda state: state.drones[0].stopped_ms is not None)
        assert flight.state.drones[0].stopped_ms > 1e3 * MUTE_S - 50.0
        assert stopped_ms is None
        assert heard >= 15  # 50 where nothing else runs; 6 where an answer puts the next off by 0.1 s
        assert flight.state.phase is Phase.STOPPED
        assert not ground.done()
    finally:
        frames.cancel()
        pump.timer.stop()
        link.close()
        await bus.close()
        os.kill(os.getpid(), 2)
        await asyncio.wait_for(ground, 30.0)
    failed = [e.text for e in events if e.source == "event loop"]
    assert failed
    assert "RuntimeError: of a library" in failed[0]
    assert failed[0] in [e.message.text for e in read_log(log).entries if e.topic is topics.REJECTED]

"""Our clients and our servers over real sockets: poses, lost and renamed bodies, servers that end and come again."""

import asyncio
from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from formation.config import LabConfig
from formation.messages import Event, RawFrame
from mocap.sources.registry import open_source
from mocap.sources.source import Feed, Source
from sim.cameras.servers.qtm import QtmServer
from sim.cameras.servers.server import Server
from sim.cameras.servers.vicon import ViconServer
from tests.free_ports import free_port
from wire.clock import REAL_TIME
from wire.rejections import RejectionLog

NAMES = ("lead", "right", "left")
POS_M = np.array([[1.0, 2.0, 0.5], [-1.0, 0.25, 1.5], [0.0, -3.0, 1.0]])
Q = Rotation.random(3, random_state=1).as_quat(scalar_first=True)
Q *= np.where(Q[:, :1] < 0.0, -1.0, 1.0)
EXPOSURE_S = 0.005


@dataclass(slots=True)
class Rig:
    """A server and our client of it; frames are published until the client has delivered what a test waits for."""

    kind: str
    port: int
    frames: list[RawFrame] = field(default_factory=list)
    said: list[Event] = field(default_factory=list)
    refusals: RejectionLog = field(default_factory=RejectionLog)
    published: int = 0

    def server(self) -> Server:
        if self.kind == "qualisys":
            return QtmServer("127.0.0.1", self.port, NAMES, 100.0, free_port())
        return ViconServer("127.0.0.1", self.port, NAMES, 100.0, REAL_TIME)

    def source(self) -> Source:
        """As the lab file names it; no bus is needed, for neither takes frames from it."""
        config = LabConfig.model_validate(
            {
                "mocap": {"source": self.kind, self.kind: {"port": self.port}},
                "leader": {"body": "lead"},
                "followers": [{"body": "right", "sysid": 2, "offset_m": (0.0, 1.0, 0.0)}],
            }
        )
        feed = Feed(config.mocap, self.frames.append, self.said.append, self.refusals, REAL_TIME)
        return open_source(config, None, feed)

    async def publish_until(self, server: Server, done: Callable[[], bool], names: tuple[str, ...] = NAMES) -> None:
        async with asyncio.timeout(60.0):
            while not done():
                self.published += 1
                seen = np.array([True, True, self.published % 2 == 0])
                exposed_ns = REAL_TIME.monotonic_ns() - round(EXPOSURE_S * 1e9)
                server.publish(RawFrame(self.published, exposed_ns, names, POS_M, Q, seen))
                await asyncio.sleep(0.01)


async def run_with(rig: Rig, flight: Callable[[Source], "asyncio.Future[None]"]) -> None:
    source = rig.source()
    running = asyncio.create_task(source.run())
    try:
        await flight(source)
    finally:
        running.cancel()
        await asyncio.gather(running, return_exceptions=True)


@pytest.fixture(params=["qualisys", "vicon"])
def rig(request) -> Rig:
    return Rig(request.param, free_port(2))


def test_poses_arrive_as_they_were_published(rig):
    async def flight(source: Source) -> None:
        server = rig.server()
        await server.start()
        await rig.publish_until(server, lambda: len(rig.frames) >= 20)
        assert source.status().connected
        await server.close()

    asyncio.run(run_with(rig, flight))
    assert {frame.bodies for frame in rig.frames} == {NAMES}
    for frame in rig.frames:
        np.testing.assert_allclose(frame.pos_mocap_m[frame.seen], POS_M[frame.seen], atol=1e-6)
        np.testing.assert_allclose(frame.q_mocap_from_marker[frame.seen], Q[frame.seen], atol=1e-6)
        assert frame.seen[:2].all()
    assert {bool(frame.seen[2]) for frame in rig.frames} == {True, False}
    assert rig.refusals.count == 0
    assert "the server names lead, right, left" in [event.text for event in rig.said]


def test_renamed_bodies_are_followed_and_a_server_that_comes_again_is_found_again(rig):
    others = ("left", "lead", "wand")

    async def flight(source: Source) -> None:
        server = rig.server()
        await server.start()
        await rig.publish_until(server, lambda: len(rig.frames) >= 5)
        await rig.publish_until(server, lambda: rig.frames[-1].bodies == others, others)
        await server.close()
        async with asyncio.timeout(60.0):
            while source.status().connected:
                await asyncio.sleep(0.01)
        before = len(rig.frames)
        server = rig.server()
        await server.start()
        await rig.publish_until(server, lambda: len(rig.frames) >= before + 5, others)
        await server.close()

    asyncio.run(run_with(rig, flight))
    assert {frame.bodies for frame in rig.frames} == {NAMES, others}
    captures = [frame.t_capture_ns for frame in rig.frames]
    assert captures == sorted(captures)
    seqs = [frame.seq for frame in rig.frames]
    assert sum(after <= before for before, after in pairwise(seqs)) == 1  # it numbers anew; MocapCore says so
    texts = [event.text for event in rig.said]
    assert any("does not name right" in text for text in texts)
    assert sum("connected to" in text for text in texts) == 2
    assert sum("trying again" in text for text in texts) >= 1


def test_a_silent_server_does_not_hold_the_client(rig):
    """It accepts and says nothing; another takes its place."""
    held: list[asyncio.StreamWriter] = []

    async def flight(source: Source) -> None:
        silent = await asyncio.start_server(lambda _, writer: held.append(writer), "127.0.0.1", rig.port)
        async with asyncio.timeout(60.0):
            while len(held) < 2:
                await asyncio.sleep(0.01)
        assert not source.status().connected
        silent.close()
        for writer in held:
            writer.close()
        server = rig.server()
        await server.start()
        await rig.publish_until(server, lambda: len(rig.frames) >= 5)
        await server.close()

    asyncio.run(run_with(rig, flight))
    assert any("no answer" in event.text or "no list" in event.text for event in rig.said)


@pytest.mark.parametrize(("host", "bound"), [("127.0.0.1", "127.0.0.1"), ("0.0.0.0", "0.0.0.0")])
def test_a_qualisys_emulator_on_loopback_answers_discoveries_of_this_machine_alone(host: str, bound: str) -> None:
    async def run() -> str:
        server = QtmServer(host, free_port(3), NAMES, 100.0, free_port())
        await server.start()
        assert server._discovery is not None
        address: str = server._discovery.get_extra_info("sockname")[0]
        await server.close()
        return address

    assert asyncio.run(run()) == bound

"""Every camera system's client and its emulated server over real sockets: poses, renamed bodies, servers that go."""

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from formation.config import LabConfig
from formation.messages import RawFrame
from mocap.sources.registry import open_source
from sim.cameras.servers.natnet import NatNetSettings, natnet_server
from sim.cameras.servers.qtm import QtmServer
from sim.cameras.servers.server import Server
from sim.cameras.systems import server_for
from tests.free_ports import free_port
from tests.mocap.sources.recorded_feed import Kept
from tests.mocap.sources.vrpn.bytes import SERVER_SAYS
from tests.wire.waiting import in_loop
from wire.clock import REAL_TIME, Clock

NAMES = ("lead", "right", "left")
POS_M = np.array([[1.0, 2.0, 0.5], [-1.0, 0.25, 1.5], [0.0, -3.0, 1.0]])
Q = Rotation.random(3, random_state=1).as_quat(scalar_first=True)
Q *= np.where(Q[:, :1] < 0.0, -1.0, 1.0)
AGE_NS, LONG_S = 5_000_000, 60.0
FLAGGED = ("natnet", "qualisys", "vicon")
"""Systems that say of each body in each frame whether it is in sight."""
SYSTEMS: dict[str, tuple[str, dict[str, Any]]] = {
    "vrpn": ("vrpn", {}),
    "vrpn by datagrams": ("vrpn", {"udp": True}),
    "chingmu": ("chingmu", {}),
    "nokov": ("nokov", {}),
    "natnet 3.0, unicast": ("natnet", {"interface": "127.0.0.2", "multicast": ""}),
    "natnet 4.2, multicast": ("natnet", {"multicast": "239.255.42.99"}),
    "qualisys": ("qualisys", {}),
    "vicon": ("vicon", {}),
    "ros2, a topic each": ("ros2", {}),
    "ros2, an array": ("ros2", {"topic": "/poses"}),
    "ros2, domain 9": ("ros2", {"domain": 9}),
}


class Rig(Kept):
    """A lab whose poses come by one system, our client of it, and as many servers as a test starts."""

    def __init__(self, kind: str, table: dict[str, Any], clock: Clock = REAL_TIME) -> None:
        port = free_port(2)
        ports = {"command_port": port, "data_port": port + 1} if kind == "natnet" else {"port": port}
        followers = [{"body": name, "sysid": k, "offset_m": (0.0, k, 0.0)} for k, name in enumerate(NAMES[1:], 2)]
        mocap = {"source": kind, kind: {"host": "127.0.0.1", **ports, **table}}
        lab = LabConfig.model_validate({"mocap": mocap, "leader": {"body": "lead"}, "followers": followers})
        super().__init__(lab.mocap, clock)
        self.kind, self.port = kind, port
        self.source = open_source(lab, None, self.feed())  # type: ignore[arg-type]
        self.sent: dict[float, RawFrame] = {}

    def server(self) -> Server:
        match self.kind:
            case "qualisys":
                return QtmServer("127.0.0.1", self.port, NAMES, 100.0, free_port())
            case "natnet":
                version = (4, 2) if self.config.natnet.multicast else (3, 0)
                return natnet_server(self.config, NAMES, self.clock, NatNetSettings(version=version))
        return server_for(self.config, NAMES, self.clock)

    def whole(self) -> list[RawFrame]:
        return [frame for frame in self.frames if set(frame.bodies) == set(NAMES)]

    async def publish_until(self, server: Server, done: Callable[[], bool], names: tuple[str, ...] = NAMES) -> None:
        """Frames of which no two are the same to the last bit, as of cameras with noise."""
        async with asyncio.timeout(LONG_S):
            while not done():
                k = len(self.sent) + 1
                seen = np.array([True, True, k % 2 == 0 or self.kind not in FLAGGED])
                pos_m = POS_M + 1e-4 * k
                frame = RawFrame(k, self.clock.monotonic_ns() - AGE_NS, names, pos_m, Q, seen)
                self.sent[round(1e4 * (pos_m[0, 0] - POS_M[0, 0]))] = frame
                server.publish(frame)
                await asyncio.sleep(0.01)

    def said(self, words: str) -> int:
        return sum(words in text for text in self.texts())


async def until(happened: Callable[[], bool]) -> None:
    async with asyncio.timeout(LONG_S):
        while not happened():
            await asyncio.sleep(0.01)


@asynccontextmanager
async def running(rig: Rig) -> AsyncIterator[None]:
    task = asyncio.create_task(rig.source.run())
    try:
        yield
    finally:
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)


@pytest.mark.parametrize("system", SYSTEMS)
@in_loop
async def test_poses_arrive_as_published_of_a_server_that_comes_late_goes_and_comes_again(system: str) -> None:
    rig = Rig(*SYSTEMS[system])
    async with running(rig):
        await until(lambda: bool(rig.events))
        reports = rig.kind != "natnet"  # which reports what it does not hear
        for times in (1, 2):
            server, before, tried = rig.server(), len(rig.whole()), rig.said("trying again")
            await server.start()
            await rig.publish_until(
                server,
                lambda n=before, k=times: (
                    len(rig.whole()) >= n + 20
                    and rig.source.status().connected
                    and (rig.said("connected to") == k or not reports)
                ),
            )
            assert set(rig.source.status().bodies) == set(NAMES)
            await server.close()
            await until(
                lambda n=tried: not rig.source.status().connected and (rig.said("trying again") > n or not reports)
            )
    for frame in rig.frames:
        if set(frame.bodies) != set(NAMES):
            continue
        rows = [frame.bodies.index(name) for name in NAMES]
        seen = frame.seen[rows]
        first = int(np.argmax(seen))  # who did not come in time, on a busy machine, keeps its last pose
        sent = rig.sent[round(1e4 * (frame.pos_mocap_m[rows[first], 0] - POS_M[first, 0]))]
        if rig.kind in FLAGGED:
            np.testing.assert_array_equal(seen, sent.seen)
        np.testing.assert_allclose(frame.pos_mocap_m[rows][seen], sent.pos_mocap_m[seen], atol=2e-6)
        np.testing.assert_allclose(frame.q_mocap_from_marker[rows][seen], Q[seen], atol=1e-6)
    assert all("later than the rest" in text for text in rig.refused())  # of a machine under load


@in_loop
async def test_a_slowed_clock_is_that_of_the_capture_times() -> None:
    slow = Clock(0.25)
    rig, begun_ns = Rig("ros2", {}, slow), slow.monotonic_ns()
    async with running(rig):
        server = rig.server()
        await server.start()
        await rig.publish_until(server, lambda: len(rig.whole()) >= 20)
        await server.close()
    captures_ns = [frame.t_capture_ns for frame in rig.whole()]
    assert captures_ns == sorted(captures_ns)
    assert begun_ns < captures_ns[0] < captures_ns[-1] < slow.monotonic_ns()


@pytest.mark.parametrize("kind", ["qualisys", "vicon"])
@in_loop
async def test_renamed_bodies_are_followed_and_a_server_that_numbers_anew(kind: str) -> None:
    rig, others = Rig(kind, {}), ("left", "lead", "wand")
    async with running(rig):
        server = rig.server()
        await server.start()
        await rig.publish_until(server, lambda: len(rig.frames) >= 5)
        await rig.publish_until(server, lambda: rig.frames[-1].bodies == others, others)
        await server.close()
        await until(lambda: not rig.source.status().connected)
        server, before = rig.server(), len(rig.frames)
        await server.start()
        await rig.publish_until(server, lambda: len(rig.frames) >= before + 5, others)
        await server.close()
    assert {frame.bodies for frame in rig.frames} == {NAMES, others}
    assert sum(b.seq <= a.seq for a, b in pairwise(rig.frames)) == 1  # it numbers anew; MocapCore says so
    assert rig.said("does not name right") >= 1


@pytest.mark.parametrize(
    ("kind", "greeting", "words"),
    [
        ("vrpn", SERVER_SAYS, "silent for 2 s"),
        ("vrpn", b"QTM RT Interface connected, welcome" + bytes(20), "not understood: the cookie is not VRPN's"),
        ("qualisys", b"", "no answer"),
        ("vicon", b"", "no answer"),
    ],
)
@in_loop
async def test_a_server_that_is_silent_or_another_is_named_and_does_not_hold_the_client(
    kind: str, greeting: bytes, words: str
) -> None:
    rig, held = Rig(kind, {}), []

    async def serve(_: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        held.append(writer)
        writer.write(greeting)

    async with running(rig):
        silent = await asyncio.start_server(serve, "127.0.0.1", rig.port)
        await until(lambda: len(held) >= 2)
        silent.close()
        for writer in held:
            writer.close()
        server = rig.server()
        await server.start()
        await rig.publish_until(server, lambda: len(rig.frames) >= 5)
        await server.close()
    assert rig.said(words) >= 1


@pytest.mark.parametrize("host", ["127.0.0.1", "0.0.0.0"])
@in_loop
async def test_a_qualisys_emulator_answers_discoveries_at_its_own_address(host: str) -> None:
    server = QtmServer(host, free_port(3), NAMES, 100.0, free_port())
    await server.start()
    assert server._discovery is not None
    assert server._discovery.get_extra_info("sockname")[0] == host
    await server.close()

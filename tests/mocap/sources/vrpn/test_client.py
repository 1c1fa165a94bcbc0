"""The client over real sockets, against the emulated server and against ones that misbehave."""

import asyncio
from collections.abc import Callable
from contextlib import asynccontextmanager

import numpy as np
import pytest

from formation.messages import RawFrame
from sim.cameras.servers.vrpn import VrpnServer, chingmu_server, vrpn_server
from tests.free_ports import free_port
from tests.mocap.sources.vrpn import bytes as vrpn_bytes
from tests.mocap.sources.vrpn.rig import Rig, lab_of
from tests.wire.waiting import in_loop
from wire.clock import REAL_TIME

BODIES = ("leader", "left", "right")
POS = np.array([[0.1, -0.2, 1.0], [1.5, 0.0, 0.25], [-3.0, 2.0, 0.0]])
Q = np.array([[1.0, 0.0, 0.0, 0.0], [0.5, 0.5, 0.5, 0.5], [0.8, 0.0, -0.6, 0.0]])
LONG_S = 60.0


def frame_of(k: int) -> RawFrame:
    return RawFrame(k, REAL_TIME.monotonic_ns(), BODIES, POS + 1e-3 * k, Q, np.ones(3, np.bool_))


def server_of(rig: Rig) -> VrpnServer:
    make = vrpn_server if rig.config.source == "vrpn" else chingmu_server
    return make(rig.config, BODIES, REAL_TIME)


@asynccontextmanager
async def running(rig: Rig):
    source = rig.source
    task = asyncio.ensure_future(source.run())
    try:
        yield source
    finally:
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)


async def until(happened: Callable[[], bool], meanwhile: Callable[[], object] = lambda: None) -> None:
    async with asyncio.timeout(LONG_S):
        while not happened():
            meanwhile()
            await asyncio.sleep(0.005)


@pytest.mark.parametrize(("kind", "server"), [("vrpn", {}), ("vrpn", {"udp": True}), ("chingmu", {})])
@in_loop
async def test_poses_arrive_as_they_were_seen_from_a_server_that_comes_late_goes_and_comes_again(
    kind: str, server: dict[str, object]
):
    rig, sent = Rig(lab_of(kind, {"port": free_port(), **server})), []
    async with running(rig) as source:
        await until(lambda: len(rig.events) == 1)
        assert "trying again" in rig.texts()[0]
        for again in (False, True):
            emulated, before = server_of(rig), len(rig.frames)
            await emulated.start()
            await until(lambda e=emulated: e.clients == 1 and source.status().connected)

            def publish(to: VrpnServer = emulated) -> None:
                sent.append(frame_of(len(sent)))
                to.publish(sent[-1])

            await until(lambda n=before: len(rig.frames) >= n + 20, publish)
            status = source.status()
            await emulated.close()
            await until(lambda: not source.status().connected)
            assert sum("connected to" in text for text in rig.texts()) == 1 + again
    assert sum("closed the connection" in text for text in rig.texts()) == 2
    published = {frame.pos_mocap_m[0, 0].round(9): frame for frame in sent}
    for frame in rig.frames[1:]:
        original = published[frame.pos_mocap_m[0, 0].round(9)]
        assert frame.bodies == BODIES
        assert frame.seen.all()
        assert frame.pos_mocap_m == pytest.approx(original.pos_mocap_m, abs=1e-12)
        assert frame.q_mocap_from_marker == pytest.approx(original.q_mocap_from_marker, abs=0.0)
    assert status.bodies == BODIES
    assert not status.latency_measured
    assert status.latency_s is not None


@pytest.mark.parametrize(
    ("greeting", "words"),
    [
        (vrpn_bytes.SERVER_SAYS, "silent for 2 s"),
        (b"QTM RT Interface connected, welcome" + bytes(20), "not understood: the cookie is not VRPN's"),
    ],
)
@in_loop
async def test_a_server_that_falls_silent_or_speaks_another_protocol_is_named_and_tried_again(greeting, words):
    rig, came = Rig(lab_of("vrpn", {"port": free_port()})), []

    async def serve(_: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        came.append(writer)
        writer.write(greeting)

    server = await asyncio.start_server(serve, "127.0.0.1", rig.config.vrpn.port)
    async with server, running(rig):
        await until(lambda: len(came) == 2)
        for writer in came:
            writer.close()
    assert any(words in text for text in rig.texts())

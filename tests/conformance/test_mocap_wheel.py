"""The `motioncapture` wheel's qualisys and vicon back ends read the emulated servers, where the wheel is installed.

It is no dependency of ours. MOTIONCAPTURE_PYTHON names a Python that has it: `python -m venv wheel`,
`wheel/bin/pip install motioncapture`.
"""

import asyncio
import json
import os
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from formation.messages import RawFrame
from sim.cameras.servers.qtm import QtmServer
from sim.cameras.servers.server import Server
from sim.cameras.servers.vicon import ViconServer
from tests.free_ports import free_port
from wire.clock import REAL_TIME

PYTHON = os.environ.get("MOTIONCAPTURE_PYTHON")
CLIENT = Path(__file__).with_name("motioncapture_client.py")
NAMES = ("lead", "right", "left")
POS_M = np.array([[1.0, 2.0, 0.5], [-1.0, 0.25, 1.5], [2.345678, -3.0, 1.0]])
Q = Rotation.random(3, random_state=1).as_quat(scalar_first=True)
WITHIN_M = 1e-5
COUNT = 100

pytestmark = [
    pytest.mark.processes,
    pytest.mark.skipif(PYTHON is None, reason="MOTIONCAPTURE_PYTHON names no Python with the motioncapture wheel"),
]


def opened(kind: str, port: int) -> tuple[Server, list[str]]:
    """A server and what the client is told of it; the wheel adds 1 to QTM's base port itself."""
    if kind == "qualisys":
        return QtmServer("127.0.0.1", port + 1, NAMES, 100.0, free_port()), ["127.0.0.1", str(port)]
    return ViconServer("127.0.0.1", port, NAMES, 100.0, REAL_TIME), [f"127.0.0.1:{port}"]


async def read(kind: str) -> list[dict[str, list[float]]]:
    server, address = opened(kind, free_port(3))
    await server.start()
    client = await asyncio.create_subprocess_exec(
        str(PYTHON), str(CLIENT), kind, *address, str(COUNT), stdout=asyncio.subprocess.PIPE
    )
    answer = asyncio.ensure_future(client.communicate())
    number = 0
    async with asyncio.timeout(60.0):
        while not answer.done():
            seen = np.array([True, True, number // 10 % 2 == 0])
            server.publish(RawFrame(number, REAL_TIME.monotonic_ns(), NAMES, POS_M, Q, seen))
            number += 1
            await asyncio.sleep(0.01)
    await server.close()
    return json.loads(answer.result()[0])


@pytest.mark.parametrize("kind", ["qualisys", "vicon"])
def test_static_poses_to_a_hundredth_of_a_millimetre(kind):
    frames = [frame for frame in asyncio.run(read(kind)) if frame]
    assert len(frames) >= COUNT - 2  # the first ones come before it has asked for poses
    assert {frozenset(frame) for frame in frames} == {frozenset(NAMES), frozenset(NAMES[:2])}
    for frame in frames:
        for name, pose in frame.items():
            k = NAMES.index(name)
            np.testing.assert_allclose(pose[:3], POS_M[k], atol=WITHIN_M)
            np.testing.assert_allclose(abs(np.dot(pose[3:], Q[k])), 1.0, atol=1e-6)

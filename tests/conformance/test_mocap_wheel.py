"""The `motioncapture` wheel (libmotioncapture) reads each of the emulated servers, where the wheel is installed.

It is no dependency of ours. MOTIONCAPTURE_PYTHON names a Python that has it: `python -m venv wheel`,
`wheel/bin/pip install motioncapture`. It reads NatNet 3.0 to 4.1, by multicast on this machine's ports 1510 and 1511.
"""

import asyncio
import json
import os
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from formation.messages import RawFrame
from formation.mocap_config import MocapConfig
from sim.cameras.servers.natnet import NatNetSettings, natnet_server
from sim.cameras.servers.qtm import QtmServer
from sim.cameras.servers.server import Server
from sim.cameras.servers.vicon import ViconServer
from sim.cameras.servers.vrpn import vrpn_server
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


def opened(kind: str, version: tuple[int, int], port: int) -> tuple[Server, list[str]]:
    """A server and what the client is told of it; the wheel adds 1 to QTM's base port itself."""
    if kind == "qualisys":
        return QtmServer("127.0.0.1", port + 1, NAMES, 100.0, free_port()), ["127.0.0.1", str(port)]
    if kind == "vicon":
        return ViconServer("127.0.0.1", port, NAMES, 100.0, REAL_TIME), [f"127.0.0.1:{port}"]
    if kind == "vrpn":
        config = MocapConfig.model_validate({"source": "vrpn", "vrpn": {"port": port}})
        return vrpn_server(config, NAMES, REAL_TIME), [f"127.0.0.1:{port}"]
    return natnet_server(MocapConfig(source="natnet"), NAMES, REAL_TIME, NatNetSettings(version=version)), ["127.0.0.1"]


async def read(kind: str, version: tuple[int, int], hides: bool) -> list[dict[str, list[float]]]:
    server, address = opened(kind, version, free_port(3))
    await server.start()
    client = await asyncio.create_subprocess_exec(
        str(PYTHON), str(CLIENT), kind, *address, str(COUNT), stdout=asyncio.subprocess.PIPE
    )
    answer = asyncio.ensure_future(client.communicate())
    number = 0
    async with asyncio.timeout(60.0):
        while not answer.done():
            number += 1
            seen = np.array([True, True, not hides or number // 10 % 2 == 0])
            server.publish(RawFrame(number, REAL_TIME.monotonic_ns() - 5_000_000, NAMES, POS_M, Q, seen))
            await asyncio.sleep(0.01)
    await server.close()
    (line,) = [line for line in answer.result()[0].decode().splitlines() if line.startswith("FRAMES ")]
    return json.loads(line.removeprefix("FRAMES "))


@pytest.mark.parametrize(
    ("kind", "version"),
    [("qualisys", ()), ("vicon", ()), ("vrpn", ()), *(("optitrack", v) for v in ((3, 0), (3, 1), (4, 0), (4, 1)))],
)
def test_static_poses_to_a_hundredth_of_a_millimetre(kind, version):
    hides = kind in ("qualisys", "vicon")
    frames = [frame for frame in asyncio.run(read(kind, version, hides)) if frame]
    assert len(frames) >= COUNT - 2 or not hides  # the first ones come before it has asked for poses
    seen = {frozenset(frame) for frame in frames}
    assert frozenset(NAMES) in seen
    assert not hides or seen == {frozenset(NAMES), frozenset(NAMES[:2])}
    for frame in frames:
        for name, pose in frame.items():
            k = NAMES.index(name)
            np.testing.assert_allclose(pose[:3], POS_M[k], atol=WITHIN_M)
            np.testing.assert_allclose(abs(np.dot(pose[3:], Q[k])), 1.0, atol=1e-6)

"""Our NatNet server read by the `motioncapture` wheel (libmotioncapture), which lives in an environment of its own.

    python -m venv /tmp/outside && /tmp/outside/bin/pip install motioncapture
    python tests/conformance/natnet.py --client /tmp/outside/bin/python

Twenty bodies at rest, versions 3.0 to 4.1 (the wheel ends on 4.2), multicast on this machine's ports 1510 and 1511.

    python tests/conformance/natnet.py --recordings python_natnet/test_data

reads what was recorded of Motive 2.1 (github.com/mje-nz/python_natnet), and compares with what NaturalPoint's
SampleClient printed of the same frame.
"""

import argparse
import asyncio
import json
import subprocess
import sys
from pathlib import Path

import numpy as np

from formation.messages import RawFrame
from formation.mocap_config import MocapConfig
from mocap.sources.natnet import messages
from mocap.sources.natnet.frames import frame_of_data
from mocap.sources.natnet.models import rigid_bodies
from sim.cameras.servers.natnet import NatNetSettings, natnet_server
from wire.clock import REAL_TIME

WITHIN_MM = 0.01
READ = """
import json, motioncapture
cameras = motioncapture.connect("optitrack", {"hostname": "127.0.0.1", "interface_ip": "127.0.0.1"})
for _ in range(50):
    cameras.waitForNextFrame()
poses = {}
for name, body in cameras.rigidBodies.items():
    q = body.rotation
    poses[name] = [float(x) for x in (*body.position, q.w, q.x, q.y, q.z)]
print(json.dumps(poses))
"""


async def worst(version: tuple[int, int], python: str) -> tuple[float, float]:
    """The farthest position, mm, and quaternion component that the client read from the truth."""
    rng = np.random.default_rng(1)
    names = tuple(f"body{k}" for k in range(20))
    pos, q = rng.uniform(-3.0, 3.0, (20, 3)), rng.normal(size=(20, 4))
    q /= np.linalg.norm(q, axis=1)[:, None]
    server = natnet_server(MocapConfig(source="natnet"), names, REAL_TIME, NatNetSettings(version=version))
    await server.start()
    client = await asyncio.create_subprocess_exec(python, "-c", READ, stdout=subprocess.PIPE)
    answer = asyncio.ensure_future(client.communicate())
    seq = 0
    try:
        async with asyncio.timeout(30.0):
            while not answer.done():
                seq += 1
                now_ns = REAL_TIME.monotonic_ns()
                server.publish(RawFrame(seq, now_ns - 5_000_000, names, pos, q, np.ones(20, np.bool_)))
                await asyncio.sleep(0.01)
    finally:
        await server.close()
        if client.returncode is None:
            client.kill()
    poses = json.loads(answer.result()[0])
    read = np.array([poses[name] for name in names])
    sign = np.sign(np.sum(read[:, 3:] * q, axis=1))[:, None]
    return 1e3 * float(np.abs(read[:, :3] - pos).max()), float(np.abs(sign * read[:, 3:] - q).max())


def judge_recordings(folder: Path) -> None:
    """Hold what was recorded of Motive 2.1 against what SampleClient printed of it; AssertionError."""
    version = (3, 0)

    def payload(name: str) -> bytes:
        return messages.unpack((folder / f"{name}_v3.bin").read_bytes())[1]

    assert messages.server_info(payload("serverinfo_packet")).text == "Motive 2.1, NatNet 3.0"
    bodies = rigid_bodies(payload("modeldef_packet"), version)
    frame = frame_of_data(payload("mocapframe_packet"), version)
    (body,) = frame.bodies
    printed = (162_734, 2, [0.17, 1.45, -0.73, -0.05, 0.51, 0.04, -0.86])
    read = (frame.number, int(body["id"]), [round(float(x), 2) for x in body["pose"]])
    assert read == printed, read
    hidden = frame_of_data(payload("mocapframe_packet_occluded"), version)
    print(f"{read} as printed; models {bodies}; with marker sets: frame {hidden.number}, {len(hidden.bodies)} body")


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0] if __doc__ else "")
    parser.add_argument("--client", default=sys.executable)
    parser.add_argument("--recordings", type=Path, help="the folder test_data of python_natnet")
    arguments = parser.parse_args()
    if arguments.recordings is not None:
        judge_recordings(arguments.recordings)
        return
    python = arguments.client
    if subprocess.run([python, "-c", "import motioncapture"], capture_output=True, check=False).returncode:
        print(f"skipped: {python} has no `motioncapture`")
        return
    failed = False
    for version in ((3, 0), (3, 1), (4, 0), (4, 1)):
        pos_mm, q = asyncio.run(worst(version, python))
        failed |= pos_mm > WITHIN_MM
        print(f"NatNet {version[0]}.{version[1]}: positions within {pos_mm:.6f} mm, quaternions within {q:.1e}")
    sys.exit(1 if failed else 0)


if __name__ == "__main__":
    main()

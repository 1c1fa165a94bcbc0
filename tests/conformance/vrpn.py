"""Our VRPN server read by other people's client, and their server by our client; run by hand, beside the project.

    python tests/conformance/vrpn.py --client VENV/bin/python --server BUILD/server_src/vrpn_server

client: an interpreter with `pip install motioncapture` (libmotioncapture, with the VRPN library inside). server: the
VRPN library's own, built from github.com/vrpn/vrpn. What is not given is not tried, and said so.
"""

import argparse
import asyncio
import json
import sys
import tempfile
from asyncio.subprocess import DEVNULL, PIPE
from contextlib import suppress
from pathlib import Path

import numpy as np

from formation.config import LabConfig
from formation.messages import Event, RawFrame
from mocap.sources.source import Feed
from mocap.sources.vrpn.client import vrpn_source
from sim.cameras.servers.vrpn import vrpn_server
from wire.clock import REAL_TIME
from wire.rejections import RejectionLog

BODIES = ("leader", "left", "right")
POS = np.array([[0.123456789, -1.5, 1.25], [3.0, 2.0, 0.001], [-2.75, 0.5, 0.0]])
Q = np.array([[0.5, 0.5, -0.5, 0.5], [0.8, 0.6, 0.0, 0.0], [0.48, 0.64, 0.0, 0.6]])
WITHIN_M, WITHIN_Q = 1e-5, 1e-6
FRAMES = 300
LONG_S = 60.0
THEIR_CLIENT = """
import json, sys, motioncapture
mocap, poses = motioncapture.connect("vrpn", {"hostname": sys.argv[1]}), {}
for _ in range(int(sys.argv[2])):
    mocap.waitForNextFrame()
    for name, body in mocap.rigidBodies.items():
        q = body.rotation
        poses[name] = [float(v) for v in body.position], [q.w, q.x, q.y, q.z]
print("POSES", json.dumps(poses), flush=True)
"""
AXIS = np.array([0.1, 0.2, 0.97])
THEIR_TRACKERS = """
vrpn_Tracker_NULL leader 1 100.0
vrpn_Tracker_Spin left 1 100.0 0.1 0.2 0.97 0.5
"""


async def their_client(python: str, port: int) -> list[str]:
    """Faults of our server, as their client sees them."""
    config = _lab(port)
    server = vrpn_server(config.mocap, BODIES, REAL_TIME)
    await server.start()
    client = await asyncio.create_subprocess_exec(
        python, "-c", THEIR_CLIENT, f"127.0.0.1:{port}", str(FRAMES), stdout=PIPE, stderr=DEVNULL
    )
    reading = asyncio.ensure_future(client.communicate())
    seen = np.ones(len(BODIES), np.bool_)
    async with asyncio.timeout(LONG_S):
        while not reading.done():
            server.publish(RawFrame(0, REAL_TIME.monotonic_ns(), BODIES, POS, Q, seen))
            await asyncio.sleep(0.01)
    await server.close()
    lines = [line for line in reading.result()[0].decode().splitlines() if line.startswith("POSES ")]
    poses = json.loads(lines[0].removeprefix("POSES ")) if lines else {}
    if sorted(poses) != sorted(BODIES):
        return [f"their client saw {sorted(poses)} (code {client.returncode}; is motioncapture installed?)"]
    off_m = max(np.abs(np.array(poses[body][0]) - POS[i]).max() for i, body in enumerate(BODIES))
    off_q = max(np.abs(np.array(poses[body][1]) - Q[i]).max() for i, body in enumerate(BODIES))
    print(f"motioncapture reads our server: {1e3 * off_m:.6f} mm, quaternion {off_q:.1e}, at most")
    return [] if off_m < WITHIN_M and off_q < WITHIN_Q else ["their client reads other poses than were served"]


async def their_server(path: str, port: int, udp: bool) -> list[str]:
    """Faults of our client at their server, one of whose trackers turns about a known axis."""
    config, frames, faults = _lab(port, udp), [], []
    events: list[Event] = []
    source = vrpn_source(config, Feed(config.mocap, frames.append, events.append, RejectionLog(), REAL_TIME))
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "vrpn.cfg").write_text(THEIR_TRACKERS)
        server = await asyncio.create_subprocess_exec(
            path, "-f", "vrpn.cfg", "-millisleep", "1", str(port), cwd=folder, stdout=DEVNULL, stderr=DEVNULL
        )
        task = asyncio.ensure_future(source.run())
        async with asyncio.timeout(LONG_S):
            while len(frames) < FRAMES:
                await asyncio.sleep(0.05)
        status = source.status()
        server.kill()
        await server.wait()
        async with asyncio.timeout(LONG_S):
            while source.status().connected:
                await asyncio.sleep(0.05)
        task.cancel()
        with suppress(asyncio.CancelledError):
            await task
    turning = np.array([f.q_mocap_from_marker[f.bodies.index("left")] for f in frames if "left" in f.bodies])
    axis = AXIS / np.linalg.norm(AXIS)
    off_axis = np.linalg.norm(np.cross(turning[:, 1:], axis), axis=1).max()
    off_unit = np.abs(np.linalg.norm(turning, axis=1) - 1.0).max()
    over = "UDP" if udp else "TCP"
    print(
        f"our client reads vrpn_server over {over}: {len(frames)} frames, {status.lost} lost, off axis {off_axis:.1e}"
    )
    if set(status.bodies) != {"leader", "left"} or max(off_axis, off_unit) > WITHIN_Q:
        faults.append(f"our client reads other poses than {path} sends")
    if not any("no tracker right" in event.text for event in events):
        faults.append("the body that their server lacks was not named")
    return faults


def _lab(port: int, udp: bool = False) -> LabConfig:
    followers = [{"body": body, "sysid": k, "offset_m": (0.0, k, 0.0)} for k, body in enumerate(BODIES[1:], 2)]
    mocap = {"source": "vrpn", "vrpn": {"port": port, "udp": udp}}
    return LabConfig.model_validate({"leader": {"body": "leader"}, "followers": followers, "mocap": mocap})


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0] if __doc__ else "")
    parser.add_argument("--client", help="an interpreter with the motioncapture wheel")
    parser.add_argument("--server", help="the VRPN library's vrpn_server")
    parser.add_argument("--port", type=int, default=39_883, help="and the two after it")
    options = parser.parse_args()
    faults: list[str] = []
    if options.client:
        faults += asyncio.run(their_client(options.client, options.port))
    else:
        print("skipped: our server under another client (--client)")
    if options.server:
        for k, udp in enumerate((False, True), 1):
            faults += asyncio.run(their_server(options.server, options.port + k, udp))
    else:
        print("skipped: our client at another server (--server)")
    for fault in faults:
        print(fault)
    sys.exit(1 if faults else 0)


if __name__ == "__main__":
    main()

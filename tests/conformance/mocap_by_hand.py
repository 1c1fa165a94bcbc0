"""What others made, read by our clients: recordings of Motive, and the VRPN library's own server; run by hand.

    python tests/conformance/mocap_by_hand.py --recordings python_natnet/test_data --server BUILD/server_src/vrpn_server

recordings: Motive 2.1's (github.com/mje-nz/python_natnet), of which NaturalPoint's SampleClient printed the same frame.
server: built from github.com/vrpn/vrpn. What is not given is not tried.
"""

import argparse
import asyncio
import sys
import tempfile
from asyncio.subprocess import DEVNULL
from contextlib import suppress
from pathlib import Path

import numpy as np

from formation.config import LabConfig
from formation.messages import Event
from mocap.sources.natnet import packets
from mocap.sources.natnet.packets import frame_of_data, rigid_bodies
from mocap.sources.source import Feed
from mocap.sources.vrpn.session import vrpn_source
from wire.clock import REAL_TIME
from wire.rejections import RejectionLog

WITHIN_Q = 1e-6
FRAMES = 300
LONG_S = 60.0
AXIS = np.array([0.1, 0.2, 0.97])
THEIR_TRACKERS = """
vrpn_Tracker_NULL leader 1 100.0
vrpn_Tracker_Spin left 1 100.0 0.1 0.2 0.97 0.5
"""


def judge_recordings(folder: Path) -> None:
    """Hold what was recorded of Motive 2.1 against what SampleClient printed of it; AssertionError."""
    version = (3, 0)

    def payload(name: str) -> bytes:
        return packets.unpack((folder / f"{name}_v3.bin").read_bytes())[1]

    assert packets.server_info(payload("serverinfo_packet")).text == "Motive 2.1, NatNet 3.0"
    bodies = rigid_bodies(payload("modeldef_packet"), version)
    frame = frame_of_data(payload("mocapframe_packet"), version)
    (body,) = frame.bodies
    printed = (162_734, 2, [0.17, 1.45, -0.73, -0.05, 0.51, 0.04, -0.86])
    read = (frame.number, int(body["id"]), [round(float(x), 2) for x in body["pose"]])
    assert read == printed, read
    hidden = frame_of_data(payload("mocapframe_packet_occluded"), version)
    print(f"{read} as printed; models {bodies}; with marker sets: frame {hidden.number}, {len(hidden.bodies)} body")


async def their_server(path: str, port: int, udp: bool) -> list[str]:
    """Faults of our client at their server, one of whose trackers turns about a known axis."""
    followers = [{"body": body, "sysid": k, "offset_m": (0.0, k, 0.0)} for k, body in enumerate(("left", "right"), 2)]
    mocap = {"source": "vrpn", "vrpn": {"port": port, "udp": udp}}
    config = LabConfig.model_validate({"leader": {"body": "leader"}, "followers": followers, "mocap": mocap})
    frames, faults = [], []
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
    off_axis = np.linalg.norm(np.cross(turning[:, 1:], AXIS / np.linalg.norm(AXIS)), axis=1).max()
    off_unit = np.abs(np.linalg.norm(turning, axis=1) - 1.0).max()
    print(f"vrpn_server, UDP {udp}: {len(frames)} frames, {status.lost} lost, off axis {off_axis:.1e}")
    if set(status.bodies) != {"leader", "left"} or max(off_axis, off_unit) > WITHIN_Q:
        faults.append(f"our client reads other poses than {path} sends")
    if not any("no tracker right" in event.text for event in events):
        faults.append("the body that their server lacks was not named")
    return faults


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0] if __doc__ else "")
    parser.add_argument("--recordings", type=Path, help="the folder test_data of python_natnet")
    parser.add_argument("--server", help="the VRPN library's vrpn_server")
    parser.add_argument("--port", type=int, default=39_883, help="and the one after it")
    options = parser.parse_args()
    if options.recordings is not None:
        judge_recordings(options.recordings)
    faults: list[str] = []
    for k, udp in enumerate((False, True) if options.server else ()):
        faults += asyncio.run(their_server(options.server, options.port + k, udp))
    for fault in faults:
        print(fault)
    sys.exit(1 if faults else 0)


if __name__ == "__main__":
    main()

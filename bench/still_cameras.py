"""The cameras' process of `bench.timings`: it shows every body of a lab at rest, as in a simulated flight."""

import itertools
import sys
from pathlib import Path

import numpy as np
import uvloop

from formation.config import LabConfig, LinkConfig
from formation.maths import frames
from formation.messages import RawFrame
from wire import clock
from wire.config_file import load
from wire.transport.mocap_bus import MocapBus
from wire.transport.zenoh_bus import ZenohBus

PERIOD_NS = 10_000_000


async def show(file: Path) -> None:
    """Listen on the bus of that lab file, and publish frames until it is ended."""
    lab = load(file, LabConfig)
    link = LinkConfig(zenoh_listen=lab.link.zenoh_connect, zenoh_connect=())
    mocap, n = MocapBus(await ZenohBus.open(link, lab.name)), len(lab.vehicles)
    bodies, q = tuple(vehicle.body for vehicle in lab.vehicles), np.tile(frames.IDENTITY, (n, 1))
    pos = np.column_stack([np.arange(n, dtype=np.float64), np.zeros(n), np.ones(n)])
    for seq in itertools.count():
        now_ns = clock.monotonic_ns()
        mocap.publish_raw(RawFrame(seq, now_ns, bodies, pos, q, np.ones(n, np.bool_)))
        await clock.REAL_TIME.sleep_until_ns(now_ns + PERIOD_NS)


if __name__ == "__main__":
    uvloop.run(show(Path(sys.argv[1])))

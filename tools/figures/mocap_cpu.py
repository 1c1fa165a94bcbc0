"""What listening to a camera system costs: each source's own client, twenty bodies at 240 Hz over real sockets.

    python -m tools.figures.mocap_cpu [--protocol natnet] [--seconds 20] [--json]

A wall-clock figure of this machine: decoding and session, without gate and bus; frames that the server numbered and
the client never delivered are counted.
"""

import argparse
import asyncio
import json
import subprocess
import sys
import time
from dataclasses import asdict, dataclass

import numpy as np

from formation.config import LabConfig
from formation.messages import Event, RawFrame
from mocap.sources.registry import open_source
from mocap.sources.source import Feed
from sim.cameras.systems import LOOPBACK, OTHER_LOOPBACK, SOURCE_OF
from wire.clock import REAL_TIME
from wire.rejections import RejectionLog

BODIES, RATE_HZ = 20, 240.0
SETTLE_S = 3.0
FORMATION = {
    "leader": {"body": "body1", "sysid": 1},
    "followers": [{"body": "body2", "sysid": 2, "offset_m": [-1, 0, 0]}],
}


@dataclass(frozen=True, slots=True)
class Cost:
    """Of one protocol: share of a core, percent; frames delivered, with all bodies, and never delivered."""

    protocol: str
    cpu_percent: float
    frames: int
    whole: int
    lost: int


async def cost(protocol: str, seconds: float) -> Cost:
    """Listen for so long, once the connection has settled."""
    source = SOURCE_OF[protocol]
    mocap: dict[str, object] = {"source": source, "rate_hz": RATE_HZ}
    if source == "natnet":
        mocap["natnet"] = {"host": OTHER_LOOPBACK, "interface": LOOPBACK}
    if source == "chingmu":
        mocap["names"] = {str(300 + k): f"body{k + 1}" for k in range(BODIES)}
    config = LabConfig.model_validate({"name": "lab", "mocap": mocap, **FORMATION})
    frames: list[RawFrame] = []
    feed = Feed(config.mocap, frames.append, _say, RejectionLog(), REAL_TIME)
    client = open_source(config, None, feed, lambda _: None)  # type: ignore[arg-type]  # no bus is asked
    running = asyncio.create_task(client.run())
    await asyncio.sleep(SETTLE_S)
    frames.clear()
    lost, used_s, start_s = client.status().lost, time.process_time(), time.monotonic()
    await asyncio.sleep(seconds)
    used_s, took_s = time.process_time() - used_s, time.monotonic() - start_s
    heard = list(frames)
    lost = client.status().lost - lost
    running.cancel()
    await asyncio.gather(running, return_exceptions=True)
    whole = sum(len(frame.bodies) == BODIES and bool(np.all(frame.seen)) for frame in heard)
    return Cost(protocol, round(100.0 * used_s / took_s, 2), len(heard), whole, lost)


def _say(event: Event) -> None:
    print(f"{event.severity.name} {event.text}", file=sys.stderr)


def measured(protocol: str, seconds: float) -> Cost:
    """The same, with a server in a process of its own."""
    import uvloop

    server = subprocess.Popen(
        [sys.executable, "-m", "sim", "mocap-server", "--protocol", protocol, "--bodies", str(BODIES),
         "--cameras", f"rate_hz={RATE_HZ}"]
    )  # fmt: skip
    try:
        return uvloop.run(cost(protocol, seconds))
    finally:
        server.terminate()
        server.wait()


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--protocol", choices=SOURCE_OF, action="append", help="all if not given")
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--json", action="store_true")
    arguments = parser.parse_args()
    for name in arguments.protocol or SOURCE_OF:
        result = measured(name, arguments.seconds)
        print(json.dumps(asdict(result)) if arguments.json else result, flush=True)

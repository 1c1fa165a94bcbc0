"""A ground for pages, out of fake drones in formation: publishes on a real bus what a GcsCore says of them, and takes
requests.

    python -m tests.gcs.page.lab --followers 19 --port 7500 --lab lab.toml
"""

import argparse
import asyncio
import sys
from dataclasses import replace
from pathlib import Path

from formation.config import LabConfig
from formation.guidance.patterns import grid
from formation.messages import OperatorReply, OperatorRequest, Verb
from formation.requests import GCS_NAME
from gcs.alarms import EventMemory
from tests.gcs.fakes import FakeLab
from wire import config_file
from wire.clock import REAL_TIME, monotonic_ns, unix_us
from wire.ground_state import Cycles, LogFile, encode
from wire.link_messages import LandedState
from wire.transport.mocap_bus import MocapBus
from wire.transport.zenoh_bus import Reply, ZenohBus

STEPS = 10


def lab_of(followers: int, port: int) -> LabConfig:
    """A leader on a circle with followers in a grid behind it, in a room that has space for them."""
    half = max(2.5, 0.6 * followers**0.5 + 1.2)
    slots = grid(followers, 0.5)
    return LabConfig.model_validate(
        {
            "leader": {
                "body": "leader",
                "sysid": 1,
                "trajectory": {"kind": "circle", "radius_m": 0.5, "laps": 100},
                "trajectories": {"eight": {"kind": "figure8", "length_m": 2.0, "period_s": 24.0}},
            },
            "followers": [
                {"body": f"cf{i + 2:02d}", "sysid": i + 2, "offset_m": [float(x) for x in slot]}
                for i, slot in enumerate(slots)
            ],
            "limits": {"fence": {"low_m": (-half - 1.0, -half, -0.1), "high_m": (half, half, 2.3)}},
            "flight": {"altitude_m": 0.8},
            "link": {"zenoh_listen": [f"tcp/127.0.0.1:{port}"], "zenoh_connect": []},
        }
    )


class Ground:
    """Fake drones in real time, ten steps a tenth of a second, and what the ground says of them."""

    def __init__(self, config: LabConfig) -> None:
        self.lab = FakeLab(config)
        for drone in self.lab.core._drones:  # what fake drones do not say
            telemetry = drone.link.telemetry
            telemetry.battery, telemetry.battery_v = 0.91 - 0.003 * drone.index, 4.02 - 0.01 * (drone.index % 7)
            telemetry.setpoint_age_s, telemetry.setpoint_age_ns = 0.0214, 2**62
        self.memory = EventMemory()
        self.waiting: dict[int, Reply] = {}
        self._events = 0

    def receive_request(self, request: OperatorRequest, reply: Reply) -> None:
        """An operator has asked."""
        self.waiting[self.lab.ask(request.verb, request.argument)] = reply

    def advance(self) -> str:
        """A tenth of a second further; the state."""
        self.lab.run(STEPS / 100.0)
        for name, event in self.lab.records[self._events :]:
            if name == "event":
                self.memory.note(event, unix_us())
        self._events = len(self.lab.records)
        for id, reply in tuple(self.waiting.items()):
            if (answer := self.lab.reply(id)) is not None:
                del self.waiting[id]
                reply(OperatorReply(0, answer.accepted, answer.text))
        host = {"events": self.memory.newest, "alarms": self.memory.alarms.open}
        log = LogFile("lab-20260301-101502.mcap", 8_400_000, 82_000_000_000)
        return encode(
            replace(self.lab.core.state(self.lab.now_ns), cycles=Cycles(self.lab.seq, 0, 2.0), log=log, **host)
        )


async def serve(config: LabConfig) -> None:
    """Until killed; each line of standard input is Python that is run upon `lab`, the FakeLab."""
    ground = Ground(config)
    bus = await ZenohBus.open(config.link, config.name)
    bus.serve(GCS_NAME, ground.receive_request)
    mocap = MocapBus(bus)
    ground.lab.fly()
    for drone in ground.lab.core._drones:
        drone.link.telemetry.landed = LandedState.IN_AIR
    loop = asyncio.get_running_loop()
    loop.add_reader(sys.stdin.fileno(), lambda: exec(sys.stdin.readline(), {"lab": ground.lab, "Verb": Verb}))
    print("ready", flush=True)
    due_ns = monotonic_ns()
    while True:
        bus.publish_state(GCS_NAME, ground.advance())
        if ground.lab.seq % 100 < STEPS:
            timing = {
                "rate_hz": 100.0,
                "jitter_s": 0.0003,
                "lost_share": 0.0,
                "delay_s": 0.006,
                "gap_s": 0.011,
                "arrival_stamps": False,
            }
            mocap.publish_state({"timing": timing})
        due_ns = max(due_ns + 100_000_000, monotonic_ns())
        await REAL_TIME.sleep_until_ns(due_ns)


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--followers", type=int, default=2)
    parser.add_argument("--port", type=int, default=7500)
    parser.add_argument("--lab", type=Path, required=True)
    given = parser.parse_args()
    config = lab_of(given.followers, given.port)
    given.lab.write_text(config_file.dump(config))
    asyncio.run(serve(config))


if __name__ == "__main__":
    main()

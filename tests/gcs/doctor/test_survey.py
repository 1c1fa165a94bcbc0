"""The whole round on real agents, through MAVSDK: a mocap turned by 90 degrees, a wrong hover thrust, a twin."""

import asyncio
import math
import os
import socket
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest

from formation.config import LabConfig, LinkConfig
from formation.maths import frames
from formation.messages import Event, RawFrame
from gcs.doctor.checks import tipped_sysids
from gcs.doctor.survey import examine, surveying
from gcs.finding import Finding, Fix, Grade
from mocap.core import MocapCore
from mocap.service import configuration_name
from tests.free_ports import free_port
from tests.gcs.fakes import FakeDrone
from wire import clock
from wire.transport.mocap_bus import MocapBus
from wire.transport.zenoh_bus import ZenohBus

pytestmark = pytest.mark.processes
HALF = math.sqrt(0.5)
Q_MOCAP_FROM_LAB = np.array([HALF, 0.0, 0.0, HALF])
STEPS = 50
"""Of 10 ms each, in which a hand moves it."""
MOVES = {"forward": [0.5, 0.0, 0.0], "to its left": [0.0, 0.5, 0.0], "up": [0.0, 0.0, 0.5]}


class Room:
    """The true place of the one drone, and a mocap whose frame is turned by 90 degrees about up."""

    def __init__(self) -> None:
        self.pos, self.yaw, self.tilt = np.array([0.3, 0.2, 0.0]), 0.0, frames.IDENTITY
        self._rng = np.random.default_rng(1)

    async def publish(self, config: LabConfig, bus: ZenohBus) -> None:
        """The cameras and the lab's mocap process in one."""
        seq, core, mocap = 0, MocapCore(config), MocapBus(bus)
        mocap.announce(configuration_name(config))
        while True:
            seq += 1
            q_lab_from_flu = frames.multiply(frames.from_yaw(np.array(self.yaw)), self.tilt)
            pos = frames.rotate(Q_MOCAP_FROM_LAB, self.pos) + self._rng.normal(0.0, 1e-4, 3)
            q = frames.multiply(Q_MOCAP_FROM_LAB, q_lab_from_flu)
            now_ns = clock.monotonic_ns()
            frame = core.receive(RawFrame(seq, now_ns, ("left",), pos[None], q[None], np.ones(1, bool)), now_ns)
            assert frame is not None
            mocap.publish_frame(frame)
            await asyncio.sleep(0.01)

    async def obey(self, text: str) -> None:
        """The operator's hand."""
        move, turn = np.zeros(3), 0.0
        for word, there in MOVES.items():
            if f" {word}" in text and "quarter" not in text and not text.startswith(("Stand", "Put")):
                move = np.array(there)
        if "quarter turn" in text:
            turn = math.pi / 2
        for _ in range(STEPS):
            self.pos, self.yaw = self.pos + move / STEPS, self.yaw + turn / STEPS
            await asyncio.sleep(0.01)


def _one_drone(lab: str, port: int, **leader: str) -> tuple[LabConfig, LinkConfig]:
    """A lab of one drone, and the listening end of its bus."""
    config = LabConfig.model_validate(
        {
            "name": lab,
            "leader": {"body": "left", "sysid": 2, **leader},
            "followers": [{"body": "right", "sysid": 3, "offset_m": (0, 1, 0)}],
            "link": {"zenoh_connect": [f"tcp/127.0.0.1:{port}"]},
        }
    )
    hub = LinkConfig(zenoh_listen=(f"tcp/127.0.0.1:{port}",), zenoh_connect=())
    return config.model_copy(update={"followers": ()}), hub


def _agent(folder: Path, lab: str, port: int, name: str) -> subprocess.Popen[bytes]:
    config = folder / "drone.toml"
    config.write_text(f"""\
parameters = {{ MPC_THR_HOVER = 0.3 }}
link = {{ zenoh_connect = ["tcp/127.0.0.1:{port}"] }}
""")
    command = [sys.executable, "-m", "drone_agent", "--config", str(config), "--sysid", "2", "--lab", lab]
    with (folder / name).open("wb") as log:
        return subprocess.Popen(command, stdout=log, stderr=subprocess.STDOUT)


async def _round(
    config: LabConfig, hub: LinkConfig, events: list[Event], twin: subprocess.Popen[bytes]
) -> tuple[list[Finding], bool]:
    """What the doctor finds of both, and whether it can write a parameter of the one that is left without the twin."""
    room, bus = Room(), await ZenohBus.open(hub, config.name)
    publisher = asyncio.create_task(room.publish(config, bus))
    try:
        async with surveying(config, Path("unused.toml"), events.append) as survey:
            async with asyncio.timeout(60.0):
                while not all(link.sequence.duplicate(clock.monotonic_ns()) for link in survey.drones.values()):
                    await asyncio.sleep(0.1)
            findings = await examine(config, room.obey, survey, 2.0)
            twin.terminate()  # of two that answer one name, the value of before may come after the new one
            await asyncio.to_thread(twin.wait)
            fixed = await survey.write(Fix(2, "COM_OF_LOSS_T", 0.75))
            return list(findings), fixed
    finally:
        publisher.cancel()
        await asyncio.gather(publisher, return_exceptions=True)
        await bus.close()


def test_every_fault_of_a_lab_is_named(tmp_path):
    lab, port = f"doctor-{os.getpid()}", free_port()
    config, hub = _one_drone(lab, port)
    twins = [_agent(tmp_path, lab, port, f"{i}.txt") for i in range(2)]
    events: list[Event] = []
    try:
        findings, fixed = asyncio.run(_round(config, hub, events, twins[1]))
    finally:
        for twin in twins:
            twin.terminate()
        for twin in twins:
            twin.wait()
    failed = {(f.subject, f.check): f.why for f in findings if f.grade is Grade.FAIL}
    assert "two drones have this sysid" in failed["left", "sysid is its own"]
    assert "turned by 90 degrees about up" in failed["left", "axes"]
    assert "change the profile" in failed["left", "MPC_THR_HOVER"]
    passed = {(f.subject, f.check) for f in findings if f.grade is Grade.PASS}
    assert {("left", "autopilot"), ("left", "body name"), ("mocap", "units")} <= passed
    assert fixed
    assert [event.text for event in events] == ["frames come from the mocap process that is running"]


async def _tipped_drone(room: Room, port: int) -> None:
    """An autopilot at a UDP port, in the drone that is in the hand."""
    drone, ground = FakeDrone(2, room.pos, 0.5), None
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as link:
        link.setblocking(False)
        link.bind(("127.0.0.1", port))
        while True:
            now_ns, drone.own_q = clock.monotonic_ns(), room.tilt
            with suppress(BlockingIOError):
                while True:
                    data, ground = link.recvfrom(65536)
                    drone.receive(data, now_ns)
            for data in drone.outgoing(now_ns) if ground else ():
                link.sendto(data, ground)
            await asyncio.sleep(0.01)


def test_the_drone_in_the_hand_is_known_by_its_autopilots_attitude():
    """By real sockets: the mocap's poses over the bus, the autopilot's attitude by its own link."""
    port, drone_port = free_port(), free_port()
    config, hub = _one_drone(f"hand-{os.getpid()}", port, link=f"udp:127.0.0.1:{drone_port}", guard="none")

    async def tipped() -> list[int]:
        room, bus = Room(), await ZenohBus.open(hub, config.name)
        tasks = [asyncio.create_task(room.publish(config, bus)), asyncio.create_task(_tipped_drone(room, drone_port))]
        try:
            async with surveying(config, Path("unused.toml"), [].append) as survey:
                await survey.settle()
                before = await survey.snapshot()
                room.tilt = np.array([math.cos(0.25), math.sin(0.25), 0.0, 0.0])
                await asyncio.sleep(1.0)
                return tipped_sysids(before, await survey.snapshot())
        finally:
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)
            await bus.close()

    assert asyncio.run(tipped()) == [2]

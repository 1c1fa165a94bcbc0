"""Count what a ROS 2 graph loses of `gcs ros2`, and what that costs: a flight's log is played at its own speed.

    gcs-sim run triangle_line --seed 3 --out .
    python -m bench.ros2 flight.mcap --count 10000

The log's frames and chunks go over a lab's bus, as from mocap process and ground, through `gcs ros2` and a router to
`pyzeros`; and poses of `pyzeros` the other way. Every topic is subscribed to. The CPU time is that of `gcs ros2`.
"""

import asyncio
import itertools
import json
import os
import subprocess
from collections import Counter
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated, Any

import pyzeros
import typer
import zenoh
from ros2_pyterfaces.cydr.geometry_msgs.msg import PoseStamped

from bench.command import FAILED, Json
from formation import topics
from formation.config import LabConfig, LinkConfig
from formation.messages import LabFrame, Phase
from sim.ports import own_ports
from wire.clock import REAL_TIME
from wire.config_file import dump
from wire.logs.live import sharer
from wire.logs.mcap_read import Entry, Stored, lab_of, read_log
from wire.logs.mcap_write import LogWriter
from wire.process.system import python_command
from wire.ros2.node import Graph, Node
from wire.transport.mocap_bus import MocapBus
from wire.transport.zenoh_bus import ZenohBus
from wire.transport.zenoh_session import zenoh_config

DOMAIN, BACK = 42, "/back/pose"
SETTLE_S = 2.0
AGE_NS = 5_000_000
"""Of a frame that is published."""


@dataclass(frozen=True, slots=True)
class Found:
    """Poses of one body sent and received, out of the lab and into it; all that came out; CPU of one core."""

    sent: int
    received: int
    sent_back: int
    received_back: int
    messages: int
    cpu_share: float

    @property
    def text(self) -> str:
        """What a person reads of it."""
        return (
            f"{self.received} of {self.sent} poses reached pyzeros, {self.received_back} of {self.sent_back} came from "
            f"it; {self.messages} messages in all, {self.cpu_share:.1%} of a core"
        )


def main(
    log: Annotated[Path, typer.Argument(help="A flight's log, played again and again.")],
    count: Annotated[int, typer.Option(min=100, help="How many frames.")] = 10_000,
    as_json: Json = False,
) -> None:
    """Play a log through `gcs ros2`; exit code 1 where a pose was lost."""
    lab, entries = lab_of(read_log(log).metadata), in_formation(log)
    if lab is None or not entries:
        raise typer.BadParameter(f"{log}: no formation was flown")
    with own_ports() as ports, TemporaryDirectory() as folder:
        found = asyncio.run(play(lab, entries, count, [f"tcp/127.0.0.1:{port}" for port in ports[1:3]], Path(folder)))
    typer.echo(json.dumps(asdict(found)) if as_json else found.text)
    if (found.sent, found.sent_back) != (found.received, found.received_back):
        raise typer.Exit(FAILED)


def in_formation(log: Path) -> list[Entry]:
    """The entries of a log while the formation was flown."""
    entries = read_log(log).entries
    flown = itertools.dropwhile(lambda entry: not _enters(entry, Phase.FORMATION), entries)
    until_landing = itertools.takewhile(lambda entry: not _enters(entry, Phase.LAND), flown)
    return [Entry(entry.topic, entry.t_ns, entry.message) for entry in until_landing]


def _enters(entry: Stored, phase: Phase) -> bool:
    return entry.topic is topics.PHASE and entry.message.phase is phase


def endless(entries: list[Entry]) -> Iterator[tuple[int, Entry]]:
    """(time since the start, entry) of the entries, again and again."""
    for round_ in itertools.count():
        for entry in entries:
            yield entry.t_ns - entries[0].t_ns + round_ * (entries[-1].t_ns - entries[0].t_ns + 10_000_000), entry


def opened(mode: str, where: str, endpoint: str) -> zenoh.Session:
    """A Zenoh session: the graph's router, or a client of it."""
    return zenoh.open(zenoh_config({"mode": mode, where: [endpoint], "scouting/multicast/enabled": False}))


def cpu_s(pid: int) -> float:
    """CPU time of a process so far."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


async def play(lab: LabConfig, entries: list[Entry], count: int, endpoints: list[str], folder: Path) -> Found:
    """Play so many frames; endpoints: of the lab's bus and of the graph's router."""
    bus_at, router_at = endpoints
    lab = lab.model_copy(update={"link": LinkConfig(zenoh_connect=(bus_at,)), "security": None})
    file = folder / "lab.toml"
    file.write_text(dump(lab), encoding="utf-8")
    bus = await ZenohBus.open(LinkConfig(zenoh_listen=(bus_at,), zenoh_connect=()), lab.name)
    router = opened("router", "listen/endpoints", router_at)
    client = opened("client", "connect/endpoints", router_at)
    heard: Counter[str] = Counter()
    client.declare_subscriber(f"{DOMAIN}/**", lambda sample: heard.update([str(sample.key_expr).split("/", 1)[0]]))
    body = lab.vehicles[-1].body
    theirs = pyzeros.Session("peer", client, domain_id=DOMAIN)
    poses: list[PoseStamped] = []
    pyzeros.Sub(PoseStamped, f"/{body}/pose", session=theirs).asap_callback.append(poses.append)
    ours, back = await Node.open(Graph(router_at, DOMAIN, node="bench")), list[bytes]()
    ours.subscribe(BACK, lambda _name, data, _ns: back.append(data))
    publisher: Any = pyzeros.Pub(PoseStamped, BACK, session=theirs)
    command = python_command("gcs", "ros2", str(file), "--router", router_at, "--domain", str(DOMAIN))
    process = subprocess.Popen(command, stdin=subprocess.DEVNULL)
    try:
        mocap = MocapBus(bus)
        while not (mocap.has_subscribers and publisher.zenoh_pub.matching_status.matching):
            await asyncio.sleep(0.1)
        await asyncio.sleep(SETTLE_S)
        used_s, begun_ns = cpu_s(process.pid), REAL_TIME.monotonic_ns()
        heard.clear()
        poses.clear()
        sent = await _play(entries, count, bus, publisher, folder)
        share = (cpu_s(process.pid) - used_s) / ((REAL_TIME.monotonic_ns() - begun_ns) * 1e-9)
        await asyncio.sleep(SETTLE_S)
        return Found(sent, len(poses), count, len(back), heard.total() - count, share)
    finally:
        process.terminate()
        process.wait()
        theirs.close()
        await ours.close()
        for session in (client, router):
            session.close()  # type: ignore[no-untyped-call]
        await bus.close()


async def _play(entries: list[Entry], count: int, bus: ZenohBus, publisher: Any, folder: Path) -> int:
    """How many poses of the last body were seen."""
    mocap, seen, frames = MocapBus(bus), 0, itertools.count(1)
    begun_ns = REAL_TIME.monotonic_ns()
    with LogWriter(folder / "shared.mcap", {}, start=REAL_TIME.pair(), share=sharer(bus, "main")) as log:
        for t_ns, entry in endless(entries):
            await REAL_TIME.sleep_until_ns(begun_ns + t_ns)
            now_ns, message = REAL_TIME.monotonic_ns(), entry.message
            log.write(entry.topic, message, now_ns)
            if not isinstance(message, LabFrame):
                continue
            number = next(frames)
            mocap.publish_frame(replace(message, seq=number, t_capture_ns=now_ns - AGE_NS, t_receive_ns=now_ns))
            publisher.publish(PoseStamped())
            await asyncio.sleep(0)  # what comes back is taken, however late the frames are
            seen += bool(message.seen[-1])
            if number == count:
                return seen
    raise AssertionError("a flight that is played again and again ends")


if __name__ == "__main__":
    typer.run(main)

"""The doctor's round: listens to mocap and drones, has drones moved by hand, interviews each through MAVSDK."""

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable, Collection, Mapping, Sequence
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import numpy as np

from formation.config import LabConfig
from formation.messages import Datagram, LabFrame
from gcs.doctor.checks import (
    DroneReport,
    Moves,
    Received,
    Snapshot,
    check_axes,
    check_drone,
    check_mocap,
    check_signing,
    unmoved,
)
from gcs.doctor.mavsdk_drone import (
    DroneError,
    MavsdkPort,
    MavsdkReport,
    fetch_log,
    interview,
    mavsdk_system,
    read_parameter,
    write_parameter,
)
from gcs.doctor.restart_record import Unmet, unmet_ns
from gcs.drones.autopilot_model import streams
from gcs.drones.link_state import DroneLink
from gcs.drones.links import close_links, open_links
from gcs.drones.telemetry import ground_heartbeat
from gcs.finding import Finding, Fix
from gcs.permissions import restart_text
from gcs.security.signing_probe import ASK_S, ASKS, SigningProbe
from mocap.service import mocap_service
from wire import clock
from wire.mavlink.framing import packed
from wire.process.daemon import EventSink, beside
from wire.rejections import RejectionLog
from wire.security.bus_access import BusAccess
from wire.security.protection import LOOPBACK_ONLY, Protection
from wire.transport.link import Deliver, Link
from wire.transport.mocap_bus import MocapBus
from wire.transport.udp_bus import open_udp_direct, open_udp_ground
from wire.transport.zenoh_bus import ZenohBus

SNAPSHOT_NS = 300_000_000
PUMP_S = 0.02
SETTLE_NS = 6_000_000_000
BEAT_NS = 1_000_000_000
STEPS = (
    "Move {name} half a metre forward, along its nose, and leave it there",
    "Move {name} half a metre to its left",
    "Lift {name} half a metre up and hold it",
    "Turn {name} left by a quarter turn, seen from above",
    "Tip {name} over to any side by some thirty degrees, and hold it so",
)

Prompt = Callable[[str], Awaitable[None]]


class Survey:
    """Everything received from one lab so far."""

    def __init__(self, config: LabConfig) -> None:
        self.config = config
        self.received: list[Received] = []
        self.unknown_bodies: tuple[str, ...] = ()
        self.retimed_scatter_s: float | None = None
        self._names = tuple(v.body for v in config.vehicles)
        self.links: Mapping[int, Link] = {}
        self.drones = {
            v.sysid: DroneLink(v, v.sysid, config.profile_of(v), streams(config))
            for v in config.vehicles
            if v.sysid is not None
        }
        self._ports: dict[int, MavsdkPort] = {}
        self._beat_ns = 0
        self.signing: tuple[Finding, ...] = ()
        """Which drones demand signatures, as it was found before the links were opened."""

    def receive_frame(self, frame: LabFrame) -> None:
        """Receive a frame; a frame of other bodies is another lab's and is ignored."""
        if frame.bodies == self._names:
            self.received.append((clock.monotonic_ns(), frame))

    def receive_mocap_state(self, state: dict[str, Any]) -> None:
        """Receive the published state of the mocap process."""
        self.unknown_bodies = tuple(str(name) for name in state.get("unknown_bodies", ()))
        self.retimed_scatter_s = state.get("retimed_scatter_s")

    def receive_datagram(self, datagram: Datagram) -> None:
        """Receive a datagram for our own link, and for MAVSDK where it listens."""
        self.drones[datagram.sysid].receive(datagram.data, clock.monotonic_ns(), datagram.superseded)
        if datagram.sysid in self._ports:
            self._ports[datagram.sysid].hand_over(datagram.data)

    async def pump(self) -> None:
        """Send heartbeats, requests and replies on every link; runs until cancelled."""
        while True:
            now_ns = clock.monotonic_ns()
            beat = now_ns - self._beat_ns >= BEAT_NS
            self._beat_ns = now_ns if beat else self._beat_ns
            for sysid, link in self.drones.items():
                messages = [*([ground_heartbeat(0)] if beat else []), *link.due(now_ns)]
                if messages:
                    for data in packed(b"".join(link.codec.encode(message) for message in messages)):
                        self.send(sysid, data)
            await asyncio.sleep(PUMP_S)

    async def settle(self) -> None:
        """Wait until every drone and a frame were heard, and have been for a moment; not for ever."""
        deadline_ns = clock.monotonic_ns() + SETTLE_NS
        while clock.monotonic_ns() < deadline_ns:
            if self.received and all(link.model is not None for link in self.drones.values()):
                break
            await asyncio.sleep(PUMP_S)
        await asyncio.sleep(SNAPSHOT_NS * 1e-9)

    def send(self, sysid: int, data: bytes) -> None:
        """Bytes to a drone."""
        if self.links:
            self.links[sysid].send(Datagram(sysid, data))

    def reads_at_boot(self, fix: Fix) -> bool:
        """Whether the drone reads that parameter only as it boots."""
        model = self.drones[fix.sysid].model
        return model is not None and fix.parameter in model.table.read_at_boot

    def recall(self, unmet: Sequence[Unmet]) -> None:
        """Parameters that were not as wanted when an earlier doctor looked."""
        for one in unmet:
            if one.sysid in self.drones:
                self.drones[one.sysid].boot_parameters.note_unmet(one.parameter, unmet_ns(one, clock.REAL_TIME))

    async def snapshot(self) -> Snapshot:
        """All bodies over the next moment: mean positions, newest attitudes; and those that the autopilots report."""
        self.received.clear()
        for link in self.drones.values():
            link.own_estimate.attitudes.clear()
        await asyncio.sleep(SNAPSHOT_NS * 1e-9)
        n = len(self.config.vehicles)
        pos, count, q = np.zeros((n, 3)), np.zeros(n), np.tile([1.0, 0.0, 0.0, 0.0], (n, 1))
        for _, frame in self.received:
            pos[frame.seen] += frame.pos_lab_m[frame.seen]
            q[frame.seen] = frame.q_lab_from_flu[frame.seen]
            count += frame.seen
        estimates = {sysid: link.own_estimate for sysid, link in self.drones.items()}
        own = {sysid: estimate.attitudes[-1][1] for sysid, estimate in estimates.items() if estimate.attitudes}
        return Snapshot(pos / np.maximum(count, 1.0)[:, None], q, count > 0.0, own)

    async def have_moved(self, prompt: Prompt) -> tuple[Moves, ...]:
        """Ask for each commanded drone's moves, one prompt a step."""
        await prompt("Stand every drone on the floor, nose along the lab's x axis, propellers off")
        moved = []
        for vehicle in self.config.commanded:
            name = self.config.vehicles[vehicle].body
            snapshots = [await self.snapshot()]
            for step in STEPS:
                await prompt(step.format(name=name))
                snapshots.append(await self.snapshot())
            start, forward, left, up, turned, tipped = snapshots
            moved.append(Moves(vehicle, (start, forward, left, up, turned, tipped)))
            await prompt(f"Put {name} back")
        return tuple(moved)

    async def interview(self, sysid: int) -> MavsdkReport:
        """One drone through MAVSDK; one that was never heard is not asked."""
        if self.drones[sysid].model is None:
            return MavsdkReport("", None, {})
        async with self._mavsdk(sysid) as system:
            if system is None:
                return MavsdkReport("", None, {})
            model = self.drones[sysid].model
            return await interview(system, () if model is None else model.parameters)

    async def fetch_log(self, sysid: int, folder: Path, report: Callable[[str], None]) -> None:
        """Download the newest log of one drone into `folder`. DroneError."""
        async with self._mavsdk(sysid) as system:
            if system is None:
                raise DroneError(f"{self.drones[sysid].name}: MAVSDK finds no autopilot")
            await fetch_log(system, folder, self.drones[sysid].name, report)

    async def write(self, fix: Fix) -> bool:
        """Write one parameter; whether it took."""
        async with self._mavsdk(fix.sysid) as system:
            return system is not None and await write_parameter(system, fix.parameter, fix.value)

    async def read(self, fix: Fix) -> float | None:
        """That parameter as it is now; None without an answer."""
        async with self._mavsdk(fix.sysid) as system:
            return None if system is None else await read_parameter(system, fix.parameter)

    def booted_ns(self, sysid: int) -> int | None:
        """When that drone's autopilot booted; None where that is not known."""
        return self.drones[sysid].booted_ns

    async def detect_restarts(self, sysids: Collection[int], since_ns: int) -> None:
        """Wait until each of these has booted since."""
        while any((self.booted_ns(sysid) or since_ns) <= since_ns for sysid in sysids):
            await asyncio.sleep(PUMP_S)

    @asynccontextmanager
    async def _mavsdk(self, sysid: int) -> AsyncIterator[object]:
        port = self._ports[sysid] = MavsdkPort(lambda data: self.send(sysid, data))
        try:
            async with mavsdk_system(port.url) as system:
                yield system
        finally:
            del self._ports[sysid]
            port.close()

    async def check_drones(self) -> tuple[Finding, ...]:
        """Interview and judge every drone."""
        findings: list[Finding] = []
        named = {vehicle.sysid for vehicle in self.config.vehicles if vehicle.names_profile}
        for sysid, link in self.drones.items():
            answers = await self.interview(sysid)
            offset_ns = link.clock.offset_ns
            report = DroneReport(
                name=link.name,
                sysid=sysid,
                profile=link.profile,
                model=link.model,
                version=answers.version,
                parameters=answers.parameters,
                unhealthy=answers.unhealthy,
                packets=link.sequence.received,
                loss=link.sequence.loss,
                round_trip_s=link.clock.round_trip_s,
                clock_offset_s=None if offset_ns is None else offset_ns * 1e-9,
                duplicate=link.sequence.duplicate(clock.monotonic_ns()),
                foreign_sysid=link.telemetry.foreign_sysid,
                battery=link.telemetry.battery,
                awaiting_restart=tuple((name, restart_text(link)) for name in link.awaiting_restart),
                names_profile=sysid in named,
            )
            findings += check_drone(report)
        return tuple(findings)


@asynccontextmanager
async def surveying(
    config: LabConfig, lab_file: Path, report: EventSink, protection: Protection = LOOPBACK_ONLY
) -> AsyncIterator[Survey]:
    """A survey of the lab, its links open and pumped. Raises what opening the bus, the links and the mocap raises."""
    bus = await ZenohBus.open_or_listen(config.link, config.name, protection=protection)  # no ground is needed
    survey = Survey(config)
    try:
        survey.signing = await probe_signing(config, protection)
        survey.links = await open_links(config, bus, survey.receive_datagram)
        mocap = MocapBus(bus)
        mocap.on_frame(survey.receive_frame)
        mocap.on_state(survey.receive_mocap_state)
        async with beside(survey.pump(), protection.attend(report)), mocap_service(config, lab_file, mocap, report):
            yield survey
    finally:
        close_links(survey.links)
        await bus.close()


async def examine(
    config: LabConfig, prompt: Prompt | None, survey: Survey, listen_s: float = 5.0
) -> tuple[Finding, ...]:
    """Every check there is, in the order an operator can follow. prompt: None skips the moves by hand."""
    await survey.settle()
    survey.received.clear()
    await asyncio.sleep(listen_s)
    findings = [*check_mocap(config, survey.received, survey.unknown_bodies, survey.retimed_scatter_s)]
    if prompt is not None and not survey.received:
        findings += unmoved(config)
    elif prompt is not None:
        findings += check_axes(config, await survey.have_moved(prompt))
    findings += await survey.check_drones()
    return (*findings, *survey.signing)


async def probe_signing(config: LabConfig, protection: Protection) -> tuple[Finding, ...]:
    """Send every drone on UDP that has a key signed and unsigned commands. Raises what opening the links raises.

    The links are the ground's own, ports too, without its signatures: an autopilot answers who spoke to it first.
    """
    probed = []
    for vehicle in config.vehicles:
        sysid, link = vehicle.sysid, vehicle.link
        channel = None if sysid is None else protection.channel(sysid)
        if sysid is not None and channel is not None and (link is not None or config.link.kind == "udp"):
            probed.append((vehicle.body, link, SigningProbe(sysid, channel)))
    await asyncio.gather(*(_probe(config, probe, link) for _, link, probe in probed))
    found = (check_signing(name, probe.outcome, is_bridged=link is None) for name, link, probe in probed)
    return tuple(finding for findings in found for finding in findings)


async def _probe(config: LabConfig, probe: SigningProbe, link: str | None) -> None:
    """Every command of a probe, and its answers."""
    opened = await _open_unsigned(
        config, probe.sysid, link, lambda datagram: probe.receive(datagram.data, clock.unix_us())
    )  # fmt: skip
    try:
        for signed in ASKS:
            now_us = clock.unix_us()
            opened.send(Datagram(probe.sysid, probe.beat(now_us, signed=True) + probe.ask(now_us, signed=signed)))
            await asyncio.sleep(ASK_S)
    finally:
        opened.close()


async def _open_unsigned(config: LabConfig, sysid: int, link: str | None, deliver: Deliver) -> Link:
    """The ground's end of a drone's link, open to unsigned packets: they are counted here, and obeyed by nobody."""
    unsigned, rejections = Protection(BusAccess(insecure=True)), RejectionLog()
    if link is not None:
        return await open_udp_direct(link, sysid, deliver, rejections, unsigned)
    return await open_udp_ground(config.link, (sysid,), deliver, rejections, unsigned)

"""Signed setpoints at a drone's UDP port while others flood it with unsigned and wrongly signed datagrams."""

import asyncio
import socket
from dataclasses import dataclass
from math import nan
from multiprocessing.queues import Queue
from threading import Event
from time import process_time

import numpy as np

from bench.security.lab import KeyedLab, participant
from formation.config import LinkConfig
from formation.messages import Datagram
from wire import clock
from wire.link_messages import GROUND, Address, AttitudeSetpoint, Ignore
from wire.mavlink.codec import Codec
from wire.mavlink.framing import SIGNATURE_BYTES, resealed
from wire.rejections import RejectionLog
from wire.security.protection import protection_of
from wire.transport.udp_bus import open_udp_drone, open_udp_ground

SYSID, PERIOD_S, SETTLE_S, ENDED_S = 1, 0.01, 1.0, 30.0
END, END_TIMES = (1 << 32) - 1, 50
"""The number that ends the count, in the place of a setpoint's time, and how often it is sent."""
BURST, TURN_S = 256, 0.001
SIGNED = 0x01


@dataclass(frozen=True, slots=True)
class Arrivals:
    """Signed setpoints that were sent and accepted, how old they were then, and what came beside them."""

    sent: int
    accepted: int
    p50_ms: float
    p99_ms: float
    hostile_hz: float
    """As they were sent."""
    core_share: float
    """Of a core, of the drone's process."""


def setpoints_beside(hostile_hz: float, count: int, lab: KeyedLab, links: LinkConfig) -> Arrivals:
    """Send so many setpoints, 100 a second, beside a flood; 0: beside none."""
    port = links.drone_port_base + SYSID
    with participant(_drone, lab, links) as accepted, participant(_flood, port, hostile_hz) as flood:
        Event().wait(SETTLE_S)
        sent_ns = asyncio.run(_send(count, lab, links))
        received_ns, core_share = accepted.get(timeout=ENDED_S)
        flooded_hz = flood.get()
        while not flood.empty():
            flooded_hz = flood.get()
    ages_ms = [(at_ns - sent_ns[k]) * 1e-6 for k, at_ns in received_ns.items()]
    p50, p99 = np.percentile(ages_ms, (50.0, 99.0)) if ages_ms else (nan, nan)
    return Arrivals(count, len(ages_ms), float(p50), float(p99), flooded_hz, core_share)


async def _send(count: int, lab: KeyedLab, links: LinkConfig) -> list[int]:
    """The ground's end; when each setpoint was sent. Its number stands in the place of its time."""
    link = await open_udp_ground(links, (SYSID,), _ignore, RejectionLog(), protection_of(lab.keys, "ground"))
    codec, begun_ns, sent_ns = Codec(GROUND), clock.monotonic_ns(), []
    for k in range(count + END_TIMES):
        await asyncio.sleep(max(0.0, k * PERIOD_S - (clock.monotonic_ns() - begun_ns) * 1e-9))
        sent_ns.append(clock.monotonic_ns())
        link.send(Datagram(SYSID, codec.encode(setpoint(k if k < count else END))))
    link.close()
    return sent_ns


def setpoint(number: int) -> AttitudeSetpoint:
    """A setpoint that hovers; its number stands in the place of its time."""
    level, still = np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(3)
    return AttitudeSetpoint(Address(SYSID, 1), number, level, still, 0.5, Ignore.BODY_RATES)


def _ignore(_datagram: Datagram) -> None:
    """Nothing that the drone says is read here."""


def _drone(queue: "Queue[object]", lab: KeyedLab, links: LinkConfig) -> None:
    """The drone's end: when each setpoint was accepted, once the count has ended, and what that cost."""

    async def receive() -> None:
        received_ns: dict[int, int] = {}
        codec, ended = Codec(Address(SYSID, 1)), asyncio.Event()

        def deliver(datagram: Datagram) -> None:
            for packet in codec.receive(datagram.data):
                if not isinstance(packet.message, AttitudeSetpoint):
                    continue
                if packet.message.t_boot_ms == END:
                    ended.set()
                else:
                    received_ns.setdefault(packet.message.t_boot_ms, clock.monotonic_ns())

        protection = protection_of(lab.keys, f"drone-{SYSID}")
        await open_udp_drone(links, SYSID, deliver, RejectionLog(), protection)
        queue.put("ready")
        begun_ns, begun_s = clock.monotonic_ns(), process_time()
        await ended.wait()
        queue.put((received_ns, (process_time() - begun_s) / ((clock.monotonic_ns() - begun_ns) * 1e-9)))
        Event().wait()

    import uvloop

    uvloop.run(receive())


def _flood(queue: "Queue[object]", port: int, rate_hz: float) -> None:
    """By turns unsigned and wrongly signed setpoints, from a stranger's port, until it is killed."""
    unsigned = Codec(GROUND).encode(setpoint(0))
    forged = (resealed(unsigned, SIGNED) or b"") + bytes(SIGNATURE_BYTES)
    queue.put("ready")
    stranger = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    stranger.connect(("127.0.0.1", port))
    sent, begun_ns, reported_s = 0, clock.monotonic_ns(), 0.0
    while True:
        elapsed_s = (clock.monotonic_ns() - begun_ns) * 1e-9
        for k in range(min(BURST, round(elapsed_s * rate_hz) - sent)):
            stranger.send(forged if k % 2 else unsigned)
            sent += 1
        if elapsed_s - reported_s > 0.5:
            reported_s = elapsed_s
            queue.put(sent / elapsed_s)
        if sent >= elapsed_s * rate_hz:
            Event().wait(TURN_S)

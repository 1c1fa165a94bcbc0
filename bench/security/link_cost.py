"""What keys cost: signing and verifying a setpoint, and TLS with access rules on a hop of the bus."""

import asyncio
import secrets
from dataclasses import dataclass
from multiprocessing.queues import Queue

import numpy as np

from bench.security.datagram_flood import setpoint
from bench.security.lab import KeyedLab, participant
from formation.config import LinkConfig
from wire import clock
from wire.link_messages import GROUND
from wire.mavlink.codec import Codec
from wire.mavlink.signing import SigningChannel, StampClock
from wire.security.private_keys import KEY_BYTES
from wire.security.protection import LOOPBACK_ONLY, Protection, protection_of
from wire.transport.zenoh_bus import ZenohBus

CALLS, HOPS, PERIOD_S = 20_000, 400, 0.005
DRONES, RATE_HZ = 100, 100
KEY = "mocap/state"


@dataclass(frozen=True, slots=True)
class Signing:
    """CPU of one packet, us, and of a core at DRONES drones and RATE_HZ packets a second, either end."""

    sign_us: float
    verify_us: float
    sign_core_share: float
    verify_core_share: float


@dataclass(frozen=True, slots=True)
class Hop:
    """From one process to another by the bus."""

    p50_us: float
    p99_us: float
    received: int


def signing_cost() -> Signing:
    """CPU of many packets: the sender's end as it signs, the receiver's as it verifies."""
    key = secrets.token_bytes(KEY_BYTES)
    sender = SigningChannel(key, StampClock(), (1).__ne__)
    receiver = SigningChannel(key, StampClock(), (1).__ne__)
    packet = Codec(GROUND).encode(setpoint(1))
    begun_ns = clock.cpu_ns()
    signed = [sender.sign(packet, clock.unix_us()) for _ in range(CALLS)]
    signed_ns = clock.cpu_ns()
    accepted = sum(bool(receiver.verify(data, clock.unix_us()).data) for data in signed)
    verified_ns = clock.cpu_ns()
    if accepted != CALLS:
        raise RuntimeError(f"{CALLS - accepted} of our own packets were rejected")
    sign_us, verify_us = (signed_ns - begun_ns) / CALLS * 1e-3, (verified_ns - signed_ns) / CALLS * 1e-3
    share = DRONES * RATE_HZ * 1e-6
    return Signing(sign_us, verify_us, sign_us * share, verify_us * share)


def bus_hop(lab: KeyedLab, endpoint: str, *, with_keys: bool) -> Hop:
    """How long a small message takes from a mocap process to a ground."""
    with participant(_publish, lab, endpoint, with_keys):
        ages_us = asyncio.run(_ages_us(lab, endpoint, with_keys))
    p50, p99 = np.percentile(ages_us, (50.0, 99.0))
    return Hop(float(p50), float(p99), len(ages_us))


def _protection(lab: KeyedLab, identity: str, with_keys: bool) -> Protection:
    return protection_of(lab.keys, identity) if with_keys else LOOPBACK_ONLY


async def _ages_us(lab: KeyedLab, endpoint: str, with_keys: bool) -> list[float]:
    listening = LinkConfig(zenoh_listen=(endpoint,), zenoh_connect=())
    bus = await ZenohBus.open(listening, "lab", protection=_protection(lab, "ground", with_keys))
    ages_us: list[float] = []
    ended = asyncio.Event()

    def receive(payload: bytes) -> None:
        ages_us.append((clock.monotonic_ns() - int(payload)) * 1e-3)
        if len(ages_us) >= HOPS:
            ended.set()

    bus.listen(KEY, lambda sample: receive(sample.payload.to_bytes()), limit=64)
    async with asyncio.timeout(60.0):
        await ended.wait()
    await bus.close()
    return ages_us[HOPS // 10 :]  # the first are of a bus that is still being joined


def _publish(queue: "Queue[str]", lab: KeyedLab, endpoint: str, with_keys: bool) -> None:
    """The mocap's end, until it is killed."""

    async def publish() -> None:
        joining = LinkConfig(zenoh_connect=(endpoint,))
        bus = await ZenohBus.open(joining, "lab", protection=_protection(lab, "mocap", with_keys))
        queue.put("ready")
        while True:
            bus.publish(KEY, str(clock.monotonic_ns()).encode())
            await asyncio.sleep(PERIOD_S)

    asyncio.run(publish())

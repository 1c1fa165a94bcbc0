"""What the fuzzers of camera systems share: packets drawn and broken, a client that must go on, and how it went."""

import random
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from formation.messages import RawFrame
from formation.mocap_config import MocapConfig
from mocap import core
from mocap.sources.source import Feed
from mocap.sources.tcp import ProtocolError, Session
from wire.clock import Clock
from wire.rejections import RejectionLog

STEP_NS = 1_000_000
PROBE_EVERY = 64
WORST_CPU_S = 0.25
"""A packet that keeps the loop longer than this has stalled it, however slow the machine."""
NUMBERS = (0, 1, 2, 3, 7, 8, 255, 2**16 - 1, 2**31 - 1, 2**31, 2**32 - 1)


@dataclass(slots=True)
class Result:
    """How it went: what raised, stalled or was locked out, in words."""

    count: int = 0
    taken: int = 0
    refused: int = 0
    dropped: int = 0
    worst_cpu_s: float = 0.0
    faults: list[str] = field(default_factory=list)

    def text(self) -> str:
        """For people."""
        return (
            f"{self.count} packets, {self.taken} frames taken, {self.refused} refused, {self.dropped} connections "
            f"ended, at most {1e3 * self.worst_cpu_s:.1f} ms of CPU for one, "
            f"{len(self.faults)} exceptions, stalls or lock-outs"
        )


class Client:
    """One source's sessions, one after the other; every frame it delivers is looked at."""

    def __init__(self, config: MocapConfig, make: Callable[[Feed], Any]) -> None:
        self.frames: list[RawFrame] = []
        self.refusals = RejectionLog()
        core.warm_up_source(config.source)
        self._source = make(Feed(config, self._take, lambda event: None, self.refusals, Clock()))
        self.session: Session = self._source.open(0, "", "")[0]

    def again(self, packets: tuple[bytes, ...], now_ns: int) -> None:
        """A new connection, and what comes first on it."""
        self.session = self._source.open(now_ns, "", "")[0]
        for packet in packets:
            self.session.received(packet, now_ns)

    def _take(self, frame: RawFrame) -> None:
        n = len(frame.bodies)
        assert frame.pos_mocap_m.shape == (n, 3)
        assert frame.q_mocap_from_marker.shape == (n, 4)
        assert frame.seen.shape == (n,)
        assert -(2**63) <= frame.t_capture_ns < 2**63
        assert 0 <= frame.seq < 2**63
        norms = np.linalg.norm(frame.q_mocap_from_marker, axis=1)
        assert ((norms == 0.0) | (np.abs(norms - 1.0) < 1e-6)).all()
        self.frames.append(frame)


def broken(rng: random.Random, packet: bytes) -> bytes:
    """A packet with some bytes or 32-bit words changed, cut short, or with more behind it."""
    data = bytearray(packet)
    for _ in range(rng.choice((0, 1, 1, 2, 8))):
        if rng.random() < 0.5 and len(data) >= 4:
            at = 4 * rng.randrange(len(data) // 4)
            data[at : at + 4] = rng.choice(NUMBERS).to_bytes(4, "little")
        elif data:
            data[rng.randrange(len(data))] = rng.randrange(256)
    if rng.random() < 0.1:
        del data[rng.randrange(len(data) + 1) :]
    elif rng.random() < 0.05:
        data += rng.randbytes(rng.choice((1, 4, 100)))
    return bytes(data)


def fuzz(client: Client, draw: Callable[[], bytes], sound: Callable[[int], tuple[bytes, ...]], count: int) -> Result:
    """Feed `count` packets. sound: a new connection's, by a number; its frame must be taken."""
    result, now_ns = Result(), 10**12
    for k in range(count):
        now_ns += STEP_NS
        data = draw()
        started = time.process_time()
        try:
            client.session.received(data, now_ns)
            client.session.due(now_ns)
            result.taken += len(client.frames)
        except ProtocolError:
            result.dropped += 1
            client.again(sound(k), now_ns)
        except Exception as error:  # noqa: BLE001 - to find any is what this is for
            result.faults.append(f"packet {k}: {type(error).__name__}: {error}: {data[:80].hex()}")
            client.again(sound(k), now_ns)
        spent_s = time.process_time() - started
        result.worst_cpu_s = max(result.worst_cpu_s, spent_s)
        if spent_s > WORST_CPU_S:
            result.faults.append(f"packet {k}: {spent_s:.2f} s of CPU: {data[:80].hex()}")
        client.frames.clear()
        if k % PROBE_EVERY == 0:
            client.again(sound(k), now_ns)
            if not client.frames or not client.frames[-1].seen.any():
                result.faults.append(f"packet {k}: a sound frame was not taken after {data[:80].hex()}")
            client.frames.clear()
        result.count += 1
    result.refused = client.refusals.count
    return result

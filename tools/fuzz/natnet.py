"""Any packets to NatNet's client: nothing raises, nothing takes long, and a sound frame is taken after all of it.

    python -m tools.fuzz.natnet --count 1000000

Packets are those of an emulated server of every version, and random bytes; mutated, cut, lengthened, with counts, byte
counts, lengths and versions of any size, numbers that are none, and headers that lie.
"""

import random
import time
from dataclasses import dataclass, field
from struct import pack

import numpy as np

from formation.messages import Event, RawFrame
from formation.mocap_config import MocapConfig, NatNetConfig
from mocap import core
from mocap.sources.natnet.session import NatNetSession
from mocap.sources.source import Feed
from sim.cameras.servers.natnet import NatNetSettings
from sim.cameras.servers.natnet.responder import Responder
from tools.fuzz.command import main
from wire.clock import Clock
from wire.rejections import RejectionLog

STEP_NS = 1_000_000
PROBE_EVERY = 1024
ANSWER_EVERY = 8
SERVER, CLIENT = "10.0.0.1", ("10.0.0.2", 4000)
VERSIONS = ((3, 0), (3, 1), (4, 0), (4, 1), (4, 2))
NUMBERS = (0, 1, 2, 38, 255, 65_535, 2**31 - 1, 2**31, 2**32 - 1)
FLOATS = (float("nan"), float("inf"), -float("inf"), 1e38, 5e-324)
KINDS = (0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 100, 65_535)


@dataclass(slots=True)
class Result:
    """How it went: what raised or was locked out, in words. slowest_s: the most CPU that one packet took."""

    count: int = 0
    taken: int = 0
    refused: int = 0
    slowest_s: float = 0.0
    faults: list[str] = field(default_factory=list)

    def text(self) -> str:
        """For people."""
        return (
            f"{self.count} packets, {self.taken} frames taken, {self.refused} refused, slowest "
            f"{1e3 * self.slowest_s:.1f} ms, {len(self.faults)} exceptions or lock-outs"
        )


class Packets:
    """Draws packets."""

    def __init__(self, seed: int) -> None:
        self._rng = random.Random(seed)
        self.servers = [Responder(NatNetSettings(version=version), 1511, None) for version in VERSIONS]
        self.seq = 0

    def draw(self, server: Responder, now_ns: int) -> bytes:
        """The next."""
        rng = self._rng
        if rng.random() < 0.1:
            payload = rng.randbytes(rng.choice((0, 1, 4, 50, 1400, 65_000)))
            size = len(payload) if rng.random() < 0.8 else rng.randrange(65_536)
            return pack("<HH", rng.choice(KINDS), size) + payload
        data = bytearray(self._sound(rng.choice(self.servers) if rng.random() < 0.2 else server, now_ns))
        for _ in range(rng.choice((0, 1, 1, 2, 8))):
            self._spoil(data)
        if rng.random() < 0.2:
            data = data[: rng.randrange(4, len(data) + 1)]
        if rng.random() < 0.05:
            data += rng.randbytes(rng.choice((1, 4, 40)))
        if rng.random() < 0.9 and len(data) >= 4:
            data[2:4] = pack("<H", (len(data) - 4) & 0xFFFF)
        return bytes(data)

    def _sound(self, server: Responder, now_ns: int) -> bytes:
        rng = self._rng
        kind = rng.random()
        if kind < 0.6:
            return self.frame(server, now_ns, rng.choice((0, 1, 2, 2, 20)))
        ask = rng.choice((pack("<HH", 0, 0), pack("<HH", 4, 0), pack("<HHQ", 12, 8, now_ns), b"\2\0\x0a\0Bitstream\0"))
        (answer,) = server.received(ask, CLIENT, now_ns)
        return answer

    def frame(self, server: Responder, now_ns: int, count: int = 2) -> bytes:
        """A sound one."""
        self.seq += 1
        names = tuple(f"b{k}" for k in range(count))
        pos, q = np.zeros((count, 3)), np.tile([1.0, 0.0, 0.0, 0.0], (count, 1))
        return server.frame(RawFrame(self.seq, now_ns - STEP_NS, names, pos, q, np.ones(count, np.bool_)), now_ns)

    def _spoil(self, data: bytearray) -> None:
        rng = self._rng
        at = rng.randrange(len(data))
        match rng.randrange(5):
            case 0:
                data[at] = rng.randrange(256)
            case 1:
                data[at : at + 4] = pack("<I", rng.choice(NUMBERS))
            case 2:
                data[at : at + 4] = pack("<f", rng.choice(FLOATS))
            case 3:
                data[at:at] = rng.randbytes(4)
            case 4:
                data[at : at + 8] = pack("<Q", rng.choice((0, 1, 2**63, 2**64 - 1)))


class Client:
    """The session, its feed, and what it said."""

    def __init__(self, now_ns: int) -> None:
        core.warm_up_source("natnet")
        mocap = MocapConfig(source="natnet", natnet=NatNetConfig(host=SERVER, multicast=""))
        self.frames: list[RawFrame] = []
        self.events: list[Event] = []
        self.refusals = RejectionLog()
        feed = Feed(mocap, self.frames.append, self.events.append, self.refusals, Clock())
        self.session = NatNetSession(NatNetConfig(host=SERVER, multicast=""), 8 * STEP_NS, ("b0",), feed)
        self.session.start(now_ns)

    def converse(self, server: Responder, now_ns: int) -> None:
        """Send what is due, and take the answers."""
        for data in self.session.due(now_ns):
            for answer in server.received(data, CLIENT, now_ns):
                self.session.received(answer, SERVER, now_ns)

    def takes(self, packets: Packets, server: Responder, now_ns: int) -> int:
        """How long it takes until a sound server's frames are taken, ns; -1 for never."""
        for k in range(8000):
            t_ns = now_ns + k * STEP_NS
            self.converse(server, t_ns)
            before = len(self.frames)
            self.session.received(packets.frame(server, t_ns), SERVER, t_ns)
            if len(self.frames) > before and self.frames[-1].bodies == ("b0", "b1"):
                return k * STEP_NS
        return -1


def fuzz(count: int, seed: int) -> Result:
    """Draw and read `count` packets."""
    result, now_ns = Result(), 10**12
    packets = Packets(seed)
    client, server = Client(now_ns), packets.servers[0]
    for k in range(count):
        now_ns += STEP_NS
        try:
            if k % PROBE_EVERY == 0:
                server = packets.servers[k // PROBE_EVERY % len(VERSIONS)]
                took_ns = client.takes(packets, server, now_ns)
                if took_ns < 0:
                    result.faults.append(f"packet {k}: sound frames are not taken any more")
                    client = Client(now_ns)
                now_ns += max(took_ns, 0) + STEP_NS
                client.frames.clear()
                client.events.clear()
            data = packets.draw(server, now_ns)
            start_s = time.thread_time()
            client.session.received(data, SERVER, now_ns)
            result.slowest_s = max(result.slowest_s, time.thread_time() - start_s)
            if k % ANSWER_EVERY == 0:
                client.converse(server, now_ns)
        except Exception as error:  # noqa: BLE001 - to find any is what this is for
            result.faults.append(f"packet {k}: {type(error).__name__}: {error}: {data[:60].hex()}")
        result.count += 1
        result.taken += len(client.frames)
        client.frames.clear()
    result.refused = client.refusals.count
    return result


if __name__ == "__main__":
    main(fuzz, __doc__)

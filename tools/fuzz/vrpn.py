"""Any bytes from a VRPN server, over TCP and as datagrams: nothing raises but what ends a connection, nothing stalls.

    python -m tools.fuzz.vrpn --count 1000000

Packets are messages as servers send them, with any names, numbers, stamps, lengths and poses, some mutated, cut or cut
apart. A connection that cannot be read on is ended and refused, as the client does; the next one must be understood.
"""

import random
import struct
import time
from dataclasses import dataclass, field

import numpy as np

from formation.config import LabConfig
from formation.messages import RawFrame
from mocap import core
from mocap.sources.source import Feed
from mocap.sources.tcp import ProtocolError
from mocap.sources.vrpn import messages
from mocap.sources.vrpn.client import chingmu_source, vrpn_source
from mocap.sources.vrpn.frames import MOST_BODIES
from tools.fuzz.command import main
from wire.clock import REAL_TIME
from wire.rejections import RejectionLog

STEP_NS = 1_000_000
STALL_S = 0.25
"""Of one thread's CPU: most packets take some 50 us, the largest (64 KB) some ms."""
POOL, POOL_LIVES = 2000, 5000
T0_STAMP_NS = 1_795_348_379_000_000_000
NAMES = (b"leader", b"left", b"MCServer", b"VRPN Control", b"", b"\xff\xfe", b"\x1b[2J", b"x" * 99, b"a b", b"../x")
TYPES = (messages.POSE_TYPE, messages.PING_TYPE, b"vrpn_Tracker Velocity", b"")
NUMBERS = (0.0, 1.0, -1.0, 1e308, -1e308, 5e-324, float("nan"), float("inf"), -float("inf"))
IDS = (0, 1, 2, 3, 1999, 2000, -1, 2**31 - 1, -(2**31))
LENGTHS = (0, 1, 23, 24, 25, 87, 88, 89, 64_024, 64_025, 2**31 - 1, 2**31, 2**32 - 1)


@dataclass(slots=True)
class Result:
    """How it went: what raised, stalled, or was not understood afterwards, in words."""

    count: int = 0
    ended: int = 0
    frames: int = 0
    refused: int = 0
    worst_s: float = 0.0
    faults: list[str] = field(default_factory=list)

    def text(self) -> str:
        """For people."""
        return (
            f"{self.count} packets, {self.frames} frames, {self.ended} connections ended, {self.refused} refusals, "
            f"worst packet {1e3 * self.worst_s:.1f} ms, {len(self.faults)} faults"
        )


class Packets:
    """Draws what arrives at once."""

    def __init__(self, seed: int) -> None:
        self._rng = random.Random(seed)
        self._stamp_ns = T0_STAMP_NS
        self._drawn = 0
        self._pool: list[bytes] = []

    def hello(self) -> bytes:
        """Of a connection: a cookie, mostly sound, and names."""
        if self._rng.random() < 0.02:
            return self._rng.randbytes(24)
        named = (messages.description(-1, k, name) for k, name in enumerate((b"leader", b"left", b"MCServer")))
        return messages.COOKIE + b"".join(named) + messages.description(-2, 4, messages.POSE_TYPE)

    def draw(self) -> bytes:
        """The next packet: messages of a pool, which is drawn anew now and then, at the time that it is."""
        rng = self._rng
        if self._drawn % POOL_LIVES == 0:
            self._pool = [self._message() for _ in range(POOL)]
        self._drawn += 1
        if rng.random() < 0.002:
            return rng.randbytes(rng.choice((1, 24, 500, 65_536)))
        if rng.random() < 0.7:
            self._stamp_ns += rng.choice((0, 0, 10_000, STEP_NS, STEP_NS, 4 * STEP_NS))
        elif rng.random() < 0.01:
            self._stamp_ns = rng.choice((0, T0_STAMP_NS, 4_294_967_295 * 10**9))
        seconds, ns = divmod(self._stamp_ns, 10**9)
        stamp = struct.pack(">II", seconds & 0xFFFFFFFF, ns // 1000 if rng.random() < 0.99 else rng.randrange(2**32))
        drawn = rng.choices(self._pool, k=rng.choice((1, 1, 1, 2, 2, 5, 20)))
        data = bytearray(b"".join(message[:4] + stamp + message[12:] for message in drawn))
        if rng.random() < 0.01:
            for _ in range(rng.choice((1, 2, 8))):
                data[rng.randrange(len(data))] = rng.randrange(256)
        return bytes(data[: rng.randrange(len(data) + 1)] if rng.random() < 0.005 else data)

    def _message(self) -> bytes:
        rng = self._rng
        draw = rng.random()
        if draw < 0.85:
            sensor = rng.choice((0, 0, 0, 300, 301, rng.randrange(-(2**31), 2**31)))
            values = (rng.choice(NUMBERS) if rng.random() < 0.1 else rng.gauss(0.0, 1.0) for _ in range(7))
            payload = struct.pack(">ii7d", sensor, sensor, *values)
            if rng.random() < 0.01:
                payload = payload[: rng.randrange(64)]
            return self._sent(payload, rng.choice((0, 1, 2, rng.choice(IDS))), 4)
        if draw < 0.9:
            return self._sent(self._name(NAMES), rng.choice((3, 4, 5, rng.choice(IDS))), -1)
        if draw < 0.93:
            return self._sent(self._name(TYPES), rng.choice((4, 5, 6, rng.choice(IDS))), -2)
        return self._sent(rng.randbytes(rng.choice((0, 7, 64))), rng.choice(IDS), rng.choice((-3, -4, -5, *IDS)))

    def _name(self, names: tuple[bytes, ...]) -> bytes:
        rng = self._rng
        name = rng.choice(names) + b"\0"
        count = len(name) if rng.random() < 0.98 else rng.choice((0, -1, 101, 2**31 - 1, len(name) + 1))
        return struct.pack(">i", count) + name

    def _sent(self, payload: bytes, sender: int, kind: int) -> bytes:
        rng = self._rng
        length = 24 + len(payload) if rng.random() < 0.998 else rng.choice(LENGTHS)
        return struct.pack(">IIIiiI", length, 0, 0, sender, kind, 0) + payload + bytes(-len(payload) % 8)


class Reader:
    """A source whose connections are begun by hand."""

    def __init__(self, kind: str, result: Result) -> None:
        lab = {
            "leader": {"body": "leader"},
            "followers": [{"body": "left", "sysid": 2, "offset_m": (0.0, 1.0, 0.0)}],
            "mocap": {"source": kind},
        }
        config = LabConfig.model_validate(lab)
        core.warm_up_source(config.mocap.source)
        self.refusals = RejectionLog()
        self._result = result
        feed = Feed(config.mocap, self._take, lambda _: None, self.refusals, REAL_TIME)
        self._feed = feed
        self._source = (vrpn_source if kind == "vrpn" else chingmu_source)(config, feed)

    def connect(self, now_ns: int) -> None:
        """Anew."""
        self.session = self._source.open(now_ns, "127.0.0.1", "127.0.0.1")[0].vrpn  # type: ignore[attr-defined]

    def read(self, data: bytes, now_ns: int, as_datagram: bool) -> bool:
        """As the client would; whether the connection goes on."""
        try:
            if as_datagram:
                self.session.datagrams((data,), now_ns)
            else:
                self.session.received(data, now_ns)
            self.session.expire(now_ns)
            self.session.due(now_ns)
        except ProtocolError as error:
            self._feed.reject(str(error))
            return False
        return True

    def _take(self, frame: RawFrame) -> None:
        n = len(frame.bodies)
        assert n <= MOST_BODIES
        assert frame.pos_mocap_m.shape == (n, 3)
        assert frame.q_mocap_from_marker.shape == (n, 4)
        assert frame.seen.shape == (n,)
        assert -(2**63) <= frame.t_capture_ns < 2**63
        self._result.frames += 1


def fuzz(count: int, seed: int) -> Result:
    """Draw and read `count` packets."""
    result, now_ns, rng = Result(), 10**12, random.Random(seed)
    packets = Packets(seed)
    with np.errstate(divide="raise", over="raise", invalid="raise"):
        for kind in ("vrpn", "chingmu"):
            reader, connected = Reader(kind, result), False
            for _ in range(count // 2):
                now_ns += STEP_NS
                if not connected:
                    reader.connect(now_ns)
                data = packets.draw() if connected else packets.hello()
                before_s = time.thread_time()
                try:
                    connected = reader.read(data, now_ns, connected and rng.random() < 0.2)
                    result.ended += not connected
                except Exception as error:  # noqa: BLE001 - to find any is what this is for
                    result.faults.append(f"packet {result.count}: {type(error).__name__}: {error}: {data[:60].hex()}")
                    connected = False
                took_s = time.thread_time() - before_s
                result.worst_s = max(result.worst_s, took_s)
                if took_s > STALL_S:
                    result.faults.append(f"packet {result.count}: {took_s:.2f} s: {len(data)} bytes")
                result.count += 1
            result.refused += reader.refusals.count
    return result


if __name__ == "__main__":
    main(fuzz, __doc__)

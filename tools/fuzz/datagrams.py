"""Any bytes to everything that reads a drone's or a ground's datagrams: nothing raises, nothing is locked out.

    python -m tools.fuzz.datagrams --count 1000000

Datagrams are random, crafted (what made parsers slow), and valid ones with any content, mutated and cut. After every
few of them each reader must still take a valid message. The slowest datagram for the codec is measured again and told.
The mocap's frames have a fuzz of their own, `fuzz_frames.py`, of the same form: `fuzz(count, seed) -> Result`.
"""

import argparse
import random
import struct
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, field

from drone_agent.config import SimulatedDroneConfig
from drone_agent.core import AgentCore
from drone_agent.guard.config import GuardConfig
from drone_agent.guard.core import GuardCore
from formation.config import VehicleBody
from formation.messages import Datagram
from formation.vehicle.profile import profile
from gcs.drones.link_state import DroneLink
from gcs.drones.telemetry import READS
from wire.link_messages import DRONE_COMPONENT, GROUND, Address, CommandAck, CommandLong, Heartbeat, MavAutopilot
from wire.mavlink.codec import Codec
from wire.mavlink.framing import CRC_EXTRA, Frame, FrameCutter, sealed

SYSID = 3
DRONE = Address(SYSID, DRONE_COMPONENT)
STEP_NS = 100_000
PROBE_EVERY = 64
MTU = 1500
KEPT_SLOWEST = 40
TIMED_EVERY = 8
POOL = 2000
BEAT = Heartbeat(MavAutopilot.PX4, 2, 0, 0, 4)
TELL_AIRSPEED = CommandLong(DRONE, 512, (148.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0))  # asks for AUTOPILOT_VERSION

CRAFTED = (
    b"\xfe", b"\xfd", b"\xfe\xfd", b"\xfe\x00", b"\xfe\xff", b"\xfd\x00", b"\xfd\x00\x01", b"\xfd\xff\x02", b"\0",
    b"\xfd\x10\x00\xfe\x05\x00", b"\xfe\x00\x00\x03\x01\x00\xaa\xaa", b"\xfd\x01\x00\x00\x00\x03\x01\x00\x00\x00\x00",
    sealed(b"\xfe\x00\x00\x03\x01\x00", CRC_EXTRA[0]), sealed(b"\xfe\x02\x00\x03\x01\xfd\x04a", CRC_EXTRA[253]),
    b"\xfe\x00\x00\x07\x01\xf0\x00\x00",
)  # fmt: skip
NUMBERS = tuple(sorted(CRC_EXTRA))
# Floats that are anything but ordinary, and the largest integers.
EXTREMES = tuple(
    [struct.pack("<f", x) for x in (float("nan"), float("inf"), -float("inf"), 3e38, -3e38, 1e-45, 0.0, 1.0)]
    + [b"\xff\xff\xff\xff", b"\xff\xff\xff\x7f", b"\x00\x00\x00\x80", b"\x1b[2J", b"[/]\n"]
)
ACTED_ON = (0, 4, 11, 20, 21, 22, 23, 30, 31, 32, 33, 43, 51, 64, 65, 66, 75, 76, 77, 82, 84, 102, 108, 110, 111, 115,
            117, 120, 132, 138, 147, 193, 230, 241, 245, 251, 252, 253, 331)  # fmt: skip


@dataclass(slots=True)
class Result:
    """How it went: what raised or was locked out, in words, and the slowest datagrams of at most 1,500 bytes."""

    count: int = 0
    faults: list[str] = field(default_factory=list)
    slowest: list[tuple[float, bytes]] = field(default_factory=list)

    def text(self) -> str:
        """For people."""
        worst = f"worst {self.slowest[0][0]:.0f} us: {self.slowest[0][1][:24].hex()}..." if self.slowest else ""
        return f"{self.count} datagrams, {len(self.faults)} exceptions or lock-outs; {worst}"


class Datagrams:
    """Draws datagrams."""

    def __init__(self, rng: random.Random) -> None:
        self._rng = rng
        self._pool: list[bytes] = []
        self._kinds: tuple[Callable[[], bytes], ...] = (
            self._random, self._padded, self._valid, self._valid, self._mutated, self._mutated, self._joined,
        )  # fmt: skip

    def draw(self) -> bytes:
        """The next."""
        return self._rng.choice(self._kinds)()

    def _random(self) -> bytes:
        return self._rng.randbytes(self._rng.choice((0, 1, 9, 64, 300, MTU, 2048, 2049, 9000)))

    def _padded(self) -> bytes:
        piece = self._rng.choice(CRAFTED)
        size = self._rng.choice((3, 280, MTU, 2048))
        lead = self._frame() if self._rng.random() < 0.3 else b""
        return (lead + (piece * (size // len(piece) + 1)))[: max(size, len(lead))]

    def _valid(self) -> bytes:
        return b"".join(self._frame() for _ in range(self._rng.choice((1, 1, 2, 12, 40))))

    def _mutated(self) -> bytes:
        data = bytearray(self._valid())
        for _ in range(self._rng.choice((1, 2, 10))):
            data[self._rng.randrange(len(data))] = self._rng.choice((0, 0xFD, 0xFE, 0xFF, self._rng.randrange(256)))
        return bytes(data[: self._rng.randrange(1, len(data) + 1)] if self._rng.random() < 0.3 else data)

    def _joined(self) -> bytes:
        return self._random()[:300] + self._valid() + self._padded()[:300]

    def _frame(self) -> bytes:
        """A sealed frame, mostly one of those drawn before: sealing costs more than reading."""
        if self._pool and self._rng.random() < 0.9:
            return self._rng.choice(self._pool)
        frame = self._sealed()
        if len(self._pool) < POOL:
            self._pool.append(frame)
        else:
            self._pool[self._rng.randrange(POOL)] = frame
        return frame

    def _sealed(self) -> bytes:
        rng = self._rng
        number = (
            rng.choice(ACTED_ON if rng.random() < 0.8 else NUMBERS) if rng.random() < 0.97 else rng.randrange(1 << 24)
        )
        payload = self._payload()
        system = SYSID if rng.random() < 0.7 else rng.randrange(256)
        component = rng.choice((1, 1, 190, 191, rng.randrange(256)))
        head = (rng.randrange(256), system, component)
        if number < 256 and rng.random() < 0.3:
            body = struct.pack("<BBBBBB", 0xFE, len(payload), *head, number)
        else:
            body = struct.pack("<BBBBBBBHB", 0xFD, len(payload), 0, 0, *head, number & 0xFFFF, number >> 16)
        return sealed(body, CRC_EXTRA.get(number, 0))

    def _payload(self) -> bytes:
        rng = self._rng
        size = rng.choice((0, 1, 4, 20, 40, 60, 120, 255))
        if rng.random() < 0.5:
            return b"".join(rng.choice(EXTREMES) for _ in range(size // 4 + 1))[:size]
        return rng.randbytes(size)


class Readers:
    """Everything that reads: the ground's end of a drone, a simulated drone, and a bridge by datagrams and serial."""

    def __init__(self) -> None:
        self.link = DroneLink(
            VehicleBody(body="left", sysid=SYSID), SYSID, profile("paper_40g"), origin=(47.0, 8.0, 0.0)
        )
        self.agent = AgentCore(SimulatedDroneConfig(sysid=SYSID, pose="mocap", body="left"), 0)
        self.bridges = [GuardCore(GuardConfig(sysid=SYSID, body="left"), 0, serial=s) for s in (False, True)]
        self._drone, self._ground = Codec(DRONE), Codec(GROUND)

    def take(self, data: bytes, now_ns: int) -> None:
        """One datagram to all."""
        self.link.receive(data, now_ns)
        self.agent.receive(Datagram(SYSID, data), now_ns)
        for bridge in self.bridges:
            bridge.receive_ground(Datagram(SYSID, data), now_ns)
            bridge.receive_autopilot(data, now_ns)

    def turn(self, now_ns: int) -> None:
        """What the daemons do in between."""
        self.link.due(now_ns)
        self.link.events.clear()
        self.agent.tick(now_ns)
        for bridge in self.bridges:
            bridge.tick(now_ns)

    def locked_out(self, now_ns: int) -> str:
        """Who does not take a valid message now; empty if all do."""
        self.turn(now_ns)
        beat = self._drone.encode(BEAT)
        self.link.receive(beat, now_ns)
        if self.link.heartbeat_ns != now_ns:
            return "the ground does not hear the drone"
        order = Datagram(SYSID, self._ground.encode(TELL_AIRSPEED))
        self.agent.receive(order, now_ns)
        said = [p for d in self.agent.tick(now_ns).datagrams for p in Codec(GROUND).receive(d.data)]
        if not any(isinstance(p.message, CommandAck) and p.message.command == 512 for p in said):
            return "the drone does not hear the ground"
        for bridge, tries in zip(self.bridges, (1, 24), strict=True):  # a line may owe the end of a frame
            passed: list[Frame] = []
            for _ in range(tries):
                bridge.receive_ground(order, now_ns)
                bridge.receive_autopilot(beat, now_ns)
                out = bridge.tick(now_ns)
                passed += [f for d in (*out.to_autopilot, *out.to_ground) for f in FrameCutter().cut(d.data)]
            payloads = {(frame.number, frame.payload) for frame in passed}
            if not {(f.number, f.payload) for data in (order.data, beat) for f in FrameCutter().cut(data)} <= payloads:
                return "the bridge does not pass what is valid"
        return ""


def fuzz(count: int, seed: int, progress: Callable[[int], None] = lambda _: None) -> Result:
    """Draw that many datagrams; `faults` is empty where all was well."""
    result = Result()
    datagrams, readers = Datagrams(random.Random(seed)), Readers()
    now_ns = 1_000_000_000
    slow: list[tuple[float, bytes]] = []
    for k in range(count):
        data = datagrams.draw()
        now_ns += STEP_NS
        if k % TIMED_EVERY == 0 and len(data) <= MTU:
            slow.append((codec_us(data), data))
            if len(slow) > 1000:
                slow = sorted(slow, reverse=True)[:KEPT_SLOWEST]
        try:
            readers.take(data, now_ns)
            if k % 16 == 0:
                readers.turn(now_ns)
            locked_out = readers.locked_out(now_ns) if k % PROBE_EVERY == 0 else ""
        except Exception as error:  # noqa: BLE001 - whatever it is, is what is looked for
            result.faults.append(f"datagram {k} of seed {seed}, {data[:60].hex()}: {type(error).__name__}: {error}")
            readers = Readers()
            continue
        if locked_out:
            result.faults.append(f"after datagram {k} of seed {seed}: {locked_out}")
            readers = Readers()
        if k % 10_000 == 0:
            progress(k)
    result.count = count
    slowest = {data for _, data in sorted(slow, reverse=True)[:KEPT_SLOWEST]} | crafted()
    result.slowest = sorted(((min(codec_us(d) for _ in range(50)), d) for d in slowest), reverse=True)
    return result


def crafted() -> set[bytes]:
    """The full datagrams of each padding and of each message that is read, as many of it as fit."""
    full = {(piece * MTU)[:MTU] for piece in CRAFTED}
    for number in ACTED_ON:
        for payload in (b"\0", b"\x01" * 40, struct.pack("<f", 1.0) * 63):
            head = struct.pack("<BBBBBBBHB", 0xFD, len(payload), 0, 0, 0, SYSID, 1, number, 0)
            frame = sealed(head + payload, CRC_EXTRA[number])
            full.add(frame * (MTU // len(frame)))
    return full


def codec_us(data: bytes) -> float:
    """CPU that the ground's codec, fresh, spends on one datagram, microseconds."""
    receive = Codec(GROUND, reads=READS).receive
    start_ns = time.thread_time_ns()
    receive(data)
    return (time.thread_time_ns() - start_ns) * 1e-3


def main() -> int:
    """Fuzz, and tell; exit code 1 if anything was found."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=1_000_000)
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    result = fuzz(given.count, given.seed, lambda k: print(f"\r{k}", end="", file=sys.stderr, flush=True))
    print("\r" + result.text())
    for us, data in result.slowest[:10]:
        print(f"{us:7.0f} us  {len(data)} bytes  {data[:24].hex()}")
    for fault in result.faults[:20]:
        print(fault)
    return 1 if result.faults else 0


if __name__ == "__main__":
    sys.exit(main())

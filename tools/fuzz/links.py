"""Datagrams of any bytes to everything that reads a drone's or a ground's: nothing raises, nobody is locked out."""

import struct
from collections import Counter

from drone_agent.config import SimulatedDroneConfig
from drone_agent.core import AgentCore
from drone_agent.guard.config import GuardConfig
from drone_agent.guard.core import GuardCore
from formation.config import VehicleBody
from formation.messages import Datagram
from formation.vehicle.profile import profile
from gcs.drones.link_state import DroneLink
from tools.fuzz.draw import Draw
from wire.link_messages import DRONE_COMPONENT, GROUND, Address, CommandAck, CommandLong, Heartbeat, MavAutopilot
from wire.mavlink.codec import Codec
from wire.mavlink.framing import CRC_EXTRA, FrameCutter, sealed

SYSID = 3
DRONE = Address(SYSID, DRONE_COMPONENT)
STEP_NS, TURN_EVERY, POOL, MTU = 100_000, 16, 2000, 1500
BEAT = Heartbeat(MavAutopilot.PX4, 2, 0, 0, 4)
ASK_VERSION = CommandLong(DRONE, 512, (148.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0))
CRAFTED = (
    b"\xfe", b"\xfd", b"\xfe\xfd", b"\xfe\x00", b"\xfe\xff", b"\xfd\x00", b"\xfd\x00\x01", b"\xfd\xff\x02", b"\0",
    b"\xfd\x10\x00\xfe\x05\x00", b"\xfe\x00\x00\x03\x01\x00\xaa\xaa", b"\xfd\x01\x00\x00\x00\x03\x01\x00\x00\x00\x00",
    sealed(b"\xfe\x00\x00\x03\x01\x00", CRC_EXTRA[0]), sealed(b"\xfe\x02\x00\x03\x01\xfd\x04a", CRC_EXTRA[253]),
    b"\xfe\x00\x00\x07\x01\xf0\x00\x00",
)  # fmt: skip
"""What made parsers slow."""
READ = (0, 4, 11, 20, 21, 22, 23, 30, 31, 32, 33, 43, 51, 64, 65, 66, 75, 76, 77, 82, 84, 102, 108, 110, 111, 115, 117,
        120, 132, 138, 147, 193, 230, 241, 245, 251, 252, 253, 331)  # fmt: skip


def crafted() -> set[bytes]:
    """The full datagrams of each padding and of each message that is read, as many of it as fit."""
    full = {(piece * MTU)[:MTU] for piece in CRAFTED}
    for number in READ:
        for payload in (b"\0", b"\x01" * 40, struct.pack("<f", 1.0) * 63):
            head = struct.pack("<BBBBBBBHB", 0xFD, len(payload), 0, 0, 0, SYSID, 1, number, 0)
            frame = sealed(head + payload, CRC_EXTRA[number])
            full.add(frame * (MTU // len(frame)))
    return full


class Links:
    """The ground's end of a drone, a simulated drone, and a bridge by datagrams and by serial line."""

    def __init__(self, draw: Draw, counts: Counter[str]) -> None:
        self._draw, self._counts = draw, counts
        self._now_ns, self._pool = 10**9, list[bytes]()
        vehicle = VehicleBody(body="left", sysid=SYSID)
        self._link = DroneLink(vehicle, SYSID, profile("paper_40g"), origin=(47.0, 8.0, 0.0))
        self._agent = AgentCore(SimulatedDroneConfig(sysid=SYSID, pose="mocap", body="left"), 0)
        self._bridges = [GuardCore(GuardConfig(sysid=SYSID, body="left"), 0, serial=s) for s in (False, True)]

    def feed(self) -> None:
        self._now_ns += STEP_NS
        data = self._datagram()
        self._link.receive(data, self._now_ns)
        self._agent.receive(Datagram(SYSID, data), self._now_ns)
        for bridge in self._bridges:
            bridge.receive_ground(Datagram(SYSID, data), self._now_ns)
            bridge.receive_autopilot(data, self._now_ns)
        if self._draw.randrange(TURN_EVERY) == 0:
            self._turn()
        self._counts["datagrams"] += 1

    def probe(self) -> str:
        """Who does not take a valid message now; empty where all do."""
        now_ns, beat = self._now_ns, Codec(DRONE).encode(BEAT)
        self._turn()
        self._link.receive(beat, now_ns)
        if self._link.heartbeat_ns != now_ns:
            return "the ground does not hear the drone"
        order = Datagram(SYSID, Codec(GROUND).encode(ASK_VERSION))
        self._agent.receive(order, now_ns)
        said = [p.message for d in self._agent.tick(now_ns).datagrams for p in Codec(GROUND).receive(d.data)]
        if not any(isinstance(message, CommandAck) and message.command == ASK_VERSION.command for message in said):
            return "the drone does not hear the ground"
        valid = {(f.number, f.payload) for data in (order.data, beat) for f in FrameCutter().cut(data)}
        for bridge, tries in zip(self._bridges, (1, 24), strict=True):  # a line may owe the end of a frame
            passed = set[tuple[int, bytes]]()
            for _ in range(tries):
                bridge.receive_ground(order, now_ns)
                bridge.receive_autopilot(beat, now_ns)
                out = bridge.tick(now_ns)
                sent = (d.data for d in (*out.to_autopilot, *out.to_ground))
                passed |= {(f.number, f.payload) for data in sent for f in FrameCutter().cut(data)}
            if not valid <= passed:
                return "the bridge does not pass what is valid"
        return ""

    def _turn(self) -> None:
        """What the daemons do in between."""
        self._link.due(self._now_ns)
        self._link.events.clear()
        self._agent.tick(self._now_ns)
        for bridge in self._bridges:
            bridge.tick(self._now_ns)

    def _datagram(self) -> bytes:
        draw = self._draw
        match draw.randrange(7):
            case 0:
                return draw.noise()
            case 1:
                piece, size = draw.choice(CRAFTED), draw.choice((3, 280, MTU, 2048))
                return (self._frame() if draw.random() < 0.3 else b"") + (piece * (size // len(piece) + 1))[:size]
            case 2:
                return draw.noise()[:300] + self._frame() + (draw.choice(CRAFTED) * 300)[:300]
            case kind:
                frames = b"".join(self._frame() for _ in range(draw.choice((1, 1, 2, 12, 40))))
                return draw.spoiled(frames, 0.0 if kind < 5 else 1.0)

    def _frame(self) -> bytes:
        """A sealed frame, mostly one of those drawn before: sealing costs more than reading."""
        draw = self._draw
        if self._pool and draw.random() < 0.9:
            return draw.choice(self._pool)
        known = draw.choice(READ if draw.random() < 0.8 else tuple(CRC_EXTRA))
        frame = draw.frame(known if draw.random() < 0.97 else draw.randrange(1 << 24), SYSID, draw.payload())
        if len(self._pool) < POOL:
            self._pool.append(frame)
        else:
            self._pool[draw.randrange(POOL)] = frame
        return frame

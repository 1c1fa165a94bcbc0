"""A Vicon DataStream server in a box, as Tracker's."""

import struct
from collections import deque
from collections.abc import Iterable, Sequence

import numpy as np

from formation.messages import RawFrame
from formation.mocap_config import MocapConfig, ViconConfig
from sim.cameras.servers.server import Server, ServerClock, TcpPort, matrices
from wire.clock import Clock

OBJECTS = 0x1A2B0001
STREAM_INFO, SUBJECT_INFO, FRAME_INFO, GLOBAL_SEGMENTS, LATENCY_INFO = 1, 2, 5, 9, 26
APPLICATION_INFO, FRAME_RATE_INFO, PING = 37, 39, 42
OBJECT_ENUMS, REQUEST_FRAME, CONTENTS, REQUEST_NEXT_FRAME = 100001, 100002, 100004, 100008
OFFERED = (
    STREAM_INFO, SUBJECT_INFO, FRAME_INFO, GLOBAL_SEGMENTS, LATENCY_INFO, APPLICATION_INFO, FRAME_RATE_INFO, PING,
    CONTENTS,
)  # fmt: skip
STATIC = (STREAM_INFO, SUBJECT_INFO, APPLICATION_INFO)
"""Blocks that are sent only when they have changed."""
TICKS_HZ = 135_000_000
Z_UP = b"\0"
_SEGMENT = np.dtype([("identifier", "<u4"), ("pos_mm", "<f8", 3), ("rotation", "<f8", (3, 3))])

Block = tuple[int, bytes]


def packet(blocks: Iterable[Block]) -> bytes:
    """Header and blocks."""
    body = b"".join(struct.pack("<II", kind, len(data)) + data for kind, data in blocks)
    return struct.pack("<II", OBJECTS, len(body)) + body


def text(words: str) -> bytes:
    """A string."""
    data = words.encode()
    return struct.pack("<I", len(data)) + data


def kinds(members: Iterable[int]) -> bytes:
    """A set of kinds."""
    ordered = sorted(members)
    return struct.pack(f"<{1 + len(ordered)}I", len(ordered), *ordered)


def contents(blocks: Sequence[Block], unchanged: Iterable[int]) -> Block:
    """How many objects of each kind follow, and which kinds are as before."""
    counts: dict[int, int] = dict.fromkeys(unchanged, 0)
    for kind, _ in blocks:
        counts[kind] = counts.get(kind, 0) + 1
    table = b"".join(struct.pack("<II", *item) for item in sorted(counts.items()))
    return CONTENTS, struct.pack("<I", len(counts)) + table + kinds(unchanged)


def static_objects(bodies: Sequence[str], rate_hz: float) -> list[Block]:
    """Frame period, subjects and axes."""
    period = struct.pack("<q", round(TICKS_HZ / rate_hz))
    subjects = [(SUBJECT_INFO, subject(k, name)) for k, name in enumerate(bodies, 1)]
    return [(STREAM_INFO, period), *subjects, (APPLICATION_INFO, Z_UP)]


def subject(identifier: int, name: str) -> bytes:
    """One rigid object: a root segment of its own name, no marker, no attachment."""
    root = struct.pack("<II6f", 0, 1, *([0.0] * 6)) + text(name)
    return struct.pack("<I", identifier) + text(name) + struct.pack("<I", 1) + root + struct.pack("<II", 0, 0)


def dynamic_objects(number: int, rate_hz: float, latencies_s: dict[str, float], frame: RawFrame) -> list[Block]:
    """Frame number, latencies, rate, and each subject's segment: a lost one is not there."""
    samples = b"".join(text(name) + struct.pack("<d", value) for name, value in latencies_s.items())
    rates = struct.pack("<I", 1) + text("Target") + struct.pack("<d", rate_hz)
    return [
        (FRAME_INFO, struct.pack("<I", number & 0xFFFFFFFF)),
        (LATENCY_INFO, struct.pack("<I", len(latencies_s)) + samples),
        (FRAME_RATE_INFO, rates),
        *global_segments(frame),
    ]


def global_segments(frame: RawFrame) -> list[Block]:
    """Millimetres and matrices, rows first."""
    roots = np.empty(len(frame.bodies), _SEGMENT)
    roots["identifier"] = 1
    roots["pos_mm"] = 1000.0 * frame.pos_mocap_m
    roots["rotation"] = matrices(frame.q_mocap_from_marker)
    data, size = roots.tobytes(), _SEGMENT.itemsize
    return [
        (GLOBAL_SEGMENTS, struct.pack("<II", k, seen) + data[(k - 1) * size : (k - 1 + seen) * size])
        for k, seen in enumerate(frame.seen.astype(int).tolist(), 1)
    ]


LARGEST_PACKET = 65_536


class ViconConversation:
    """One client's: which kinds of objects it wants, whether they are pushed, and what it has of those that change."""

    def __init__(self) -> None:
        self.wanted: frozenset[int] = frozenset()
        self.streaming = False
        self.requested = 0
        """Frames it has asked for one by one."""
        self.has: object = None
        """The static objects it was sent."""
        self._data = bytearray()

    @property
    def wants_frame(self) -> bool:
        """Whether the next frame is for it."""
        return bool(self.wanted) and (self.streaming or self.requested > 0)

    def received(self, data: bytes) -> bytes:
        """Take the next bytes; what to answer. ValueError for what is no packet of objects."""
        self._data += data
        answers = []
        while len(self._data) >= 8:
            tag, size = struct.unpack_from("<II", self._data)
            if tag != OBJECTS or size > LARGEST_PACKET:
                raise ValueError("not a packet of objects")
            if len(self._data) < 8 + size:
                break
            answers.append(self._packet(bytes(self._data[8 : 8 + size])))
            del self._data[: 8 + size]
        return b"".join(answers)

    def _packet(self, body: bytes) -> bytes:
        answers, at = [], 0
        while at < len(body):
            try:
                kind, size = struct.unpack_from("<II", body, at)
                answers.append(self._object(kind, body[at + 8 : at + 8 + size]))
            except struct.error as error:
                raise ValueError("an object cut short") from error
            at += 8 + size
        return b"".join(answers)

    def _object(self, kind: int, data: bytes) -> bytes:
        if kind == OBJECT_ENUMS:
            n = struct.unpack_from("<I", data)[0]
            if n > len(data) // 4:
                raise ValueError("a set longer than its object")
            self.wanted = frozenset(struct.unpack_from(f"<{n}I", data, 4)) & frozenset(OFFERED)
            self.has = None
        elif kind == REQUEST_FRAME:
            self.streaming = struct.unpack_from("<?", data)[0]
            self.requested = 0 if self.streaming else 1
        elif kind == REQUEST_NEXT_FRAME:
            self.requested += 1
        elif kind == PING:
            return packet([(PING, data[:8])])
        return b""


REMEMBERED = 200
FIRST_FRAME = 1000
"""Real servers count since the cameras were started, not since anybody connected."""
EXPOSURE_SHARE = 0.4
"""The cameras' share of the latency; the rest is the program's."""


def vicon_server(config: MocapConfig, bodies: tuple[str, ...], clock: Clock) -> Server:
    """Where the lab file's client looks for it."""
    vicon = config.vicon or ViconConfig()
    return ViconServer(vicon.host, vicon.port, bodies, config.rate_hz, clock)


class ViconServer:
    """Frames are numbered by its own clock's frame periods, so that one that is not published leaves a gap."""

    def __init__(self, host: str, port: int, bodies: tuple[str, ...], rate_hz: float, clock: Clock) -> None:
        self._bodies = bodies
        self._rate_hz = rate_hz
        self._clock = clock
        self._time = ServerClock()
        self._number = 0
        self._ages_ns: deque[int] = deque(maxlen=REMEMBERED)
        hello = packet([(OBJECT_ENUMS, kinds(OFFERED))])
        self._port = TcpPort(host, port, lambda _: (ViconConversation(), hello))

    async def start(self) -> None:
        """Listen, frames counted anew; OSError where the address is taken."""
        self._time, self._number = ServerClock(), 0
        self._ages_ns.clear()
        await self._port.start()

    def publish(self, frame: RawFrame) -> None:
        """One exposure to every client that streams or has asked for a frame."""
        self._bodies = frame.bodies
        periods = round(self._time.at_ns(frame.t_capture_ns) * self._rate_hz * 1e-9)
        self._number = max(self._number + 1, FIRST_FRAME + periods)
        # What the program takes of itself; what comes on top now and then is not known to it.
        self._ages_ns.append(max(self._clock.monotonic_ns() - frame.t_capture_ns, 0))
        latency_s = 1e-9 * min(self._ages_ns)
        latencies_s = {"Exposure": EXPOSURE_SHARE * latency_s, "Processing": (1.0 - EXPOSURE_SHARE) * latency_s}
        if any(client.wants_frame for client in self._port.conversations()):
            dynamic = dynamic_objects(self._number, self._rate_hz, latencies_s, frame)
            made: dict[tuple[frozenset[int], bool], bytes] = {}
            self._port.send(lambda to: self._frame_for(to, dynamic, made))

    async def close(self) -> None:
        """End every connection and listen no more."""
        await self._port.close()

    def _frame_for(
        self, to: ViconConversation, dynamic: list[Block], made: dict[tuple[frozenset[int], bool], bytes]
    ) -> bytes:
        if not to.wants_frame:
            return b""
        to.requested = max(to.requested - 1, 0)
        knows, to.has = to.has == self._bodies, self._bodies
        key = to.wanted, knows
        if key not in made:
            made[key] = self._packet(to.wanted, knows, dynamic)
        return made[key]

    def _packet(self, wanted: frozenset[int], knows: bool, dynamic: list[Block]) -> bytes:
        static = [] if knows else static_objects(self._bodies, self._rate_hz)
        blocks = [block for block in (*static, *dynamic) if block[0] in wanted]
        if CONTENTS in wanted:
            unchanged = wanted.intersection(STATIC) if knows else ()
            blocks.insert(0, contents(blocks, unchanged))
        return packet(blocks)

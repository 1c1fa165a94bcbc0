"""What camera systems send, to their clients: an emulated server's packets of anything, most of them broken."""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import Any

import numpy as np

from formation.config import LabConfig
from formation.messages import RawFrame
from mocap import core
from mocap.sources.natnet.session import NatNetSession
from mocap.sources.registry import open_source
from mocap.sources.ros2 import ARRAY, Ros2Source
from mocap.sources.rosbag import POSE_AT
from mocap.sources.source import Feed
from mocap.sources.tcp import ProtocolError
from mocap.sources.vrpn import messages
from sim.cameras.servers import qtm, vicon
from sim.cameras.servers.natnet import NatNetSettings, Responder
from sim.cameras.servers.vrpn import Names, SensorEach, ServerKind, TrackerEach
from tools.fuzz.draw import TEXTS, Draw
from wire.clock import Clock
from wire.rejections import RejectionLog
from wire.ros2.message_types import MessageType, Values, message_type

STEP_NS = 1_000_000
BODIES = ("lead", "left")
VERSIONS = ((3, 0), (3, 1), (4, 0), (4, 1), (4, 2))
HOST, CLIENT = "10.0.0.1", ("10.0.0.2", 4000)
PATIENCE = 8000
"""Frames until NatNet's client must have understood a sound server again."""


class Qtm:
    """Of a system that streams over TCP: what a connection begins with, and a frame."""

    def opening(self, bodies: Sequence[str]) -> list[bytes]:
        words = (qtm.text("<", qtm.COMMAND, text) for text in ("QTM RT Interface connected", "Version set to 1.19"))
        return [*words, qtm.text("<", qtm.XML, qtm.parameters_6d(19, bodies))]

    def exposure(self, frame: RawFrame, number: int) -> bytes:
        kinds = (5,) if number % 8 else (11, 5, 6)
        parts = [qtm.six_d("<", kind, frame) for kind in kinds]
        return qtm.data_packet("<", frame.t_capture_ns // 1000, number, parts)


class Vicon:
    def __init__(self) -> None:
        self._has_named = False

    def opening(self, bodies: Sequence[str]) -> list[bytes]:
        self._has_named = False
        return [vicon.packet([(vicon.OBJECT_ENUMS, vicon.kinds(vicon.OFFERED))])]

    def exposure(self, frame: RawFrame, number: int) -> bytes:
        static = [] if self._has_named and number % 4 else vicon.static_objects(frame.bodies, 240.0)
        self._has_named = True
        blocks = [*static, *vicon.dynamic_objects(number, 240.0, {"Processing": 0.002}, frame)]
        return vicon.packet([vicon.contents(blocks, () if static else vicon.STATIC), *blocks])


class Vrpn:
    def __init__(self, kind: ServerKind) -> None:
        self._kind, self._names = kind, Names(messages.COOKIE, lambda: 0)

    def opening(self, bodies: Sequence[str]) -> list[bytes]:
        self._names = Names(messages.COOKIE, lambda: 0)
        self._names.add(name.encode() for name in self._kind.senders(tuple(bodies)))
        return [messages.COOKIE + self._names.all()]

    def exposure(self, frame: RawFrame, number: int) -> bytes:
        return b"".join(
            messages.message(
                frame.t_capture_ns + later_ns, self._names.number(sender.encode()) or number % 5, 0,
                messages.POSE.pack(sensor, sensor, *pos, x, y, z, w),
            )
            for sender, sensor, pos, (w, x, y, z), later_ns in self._kind.reports(frame)
        )  # fmt: skip


SERVERS: Mapping[str, Callable[[], Qtm | Vicon | Vrpn]] = MappingProxyType(
    {
        "qualisys": Qtm,
        "vicon": Vicon,
        "vrpn": lambda: Vrpn(TrackerEach(1.0)),
        "chingmu": lambda: Vrpn(SensorEach(0.001, "MCServer", {})),
    }
)


class Camera:
    """A client's frames as they are delivered, each of the shape that it says; and frames for its server to send."""

    def __init__(self, draw: Draw, counts: Counter[str], source: str, **options: object) -> None:
        followers = [{"body": BODIES[1], "sysid": 2, "offset_m": (0.0, 1.0, 0.0)}]
        lab = {"leader": {"body": BODIES[0]}, "followers": followers, "mocap": {"source": source, source: options}}
        self._config, self._draw, self._counts = LabConfig.model_validate(lab), draw, counts
        self._now_ns, self._number, self._last = 10**12, 0, sound_frame(0)
        self._log = RejectionLog()
        self._feed = Feed(self._config.mocap, self._take, lambda _event: None, self._log, Clock())
        core.warm_up_source(source)

    def _take(self, frame: RawFrame) -> None:
        n = len(frame.bodies)
        shapes = frame.pos_mocap_m.shape, frame.q_mocap_from_marker.shape, frame.seen.shape
        assert shapes == ((n, 3), (n, 4), (n,)), shapes
        assert -(2**63) <= frame.t_capture_ns < 2**63
        assert 0 <= frame.seq < 2**63
        if self._config.mocap.source in core.MATRICES:
            norms = np.linalg.norm(frame.q_mocap_from_marker, axis=1)
            assert ((norms == 0.0) | (np.abs(norms - 1.0) < 1e-6)).all()
        self._counts["taken"] += 1
        self._last = frame

    def _frame(self) -> RawFrame:
        """Of any number of bodies, anywhere."""
        draw = self._draw
        n = draw.choice((0, 1, 2, 2, 2, 2, 20))
        bodies = BODIES if n == 2 else tuple(f"b{k}" for k in range(n))
        seen = np.array([draw.random() < 0.9 for _ in range(n)], dtype=np.bool_)
        stamp_ns = draw.choice((self._now_ns, self._now_ns, self._now_ns, draw.randrange(2**62)))
        return RawFrame(self._number, stamp_ns, bodies, draw.rows(n, 3), draw.quaternions(n), seen)


class TcpCamera(Camera):
    """A client over TCP. What it cannot read ends its connection; the next one must be understood."""

    def __init__(self, draw: Draw, counts: Counter[str], source: str) -> None:
        super().__init__(draw, counts, source)
        self._server = SERVERS[source]()
        self._source: Any = open_source(self._config, None, self._feed)  # type: ignore[arg-type]
        self._connect(BODIES)

    def feed(self) -> None:
        draw = self._draw
        self._now_ns += STEP_NS
        try:
            data = draw.spoiled(self._packet(), 0.7)
            if hasattr(self._session, "datagrams") and draw.random() < 0.2:
                self._session.datagrams((data,), self._now_ns)
            else:
                self._session.received(data, self._now_ns)
            self._session.due(self._now_ns)
        except ProtocolError as error:
            self._feed.reject(str(error))
            self._counts["connections ended"] += 1
            self._connect(draw.choice((BODIES, draw.choices(TEXTS[:5], k=draw.choice((0, 1, 2, 20))))))
        self._counts["rejected"] = self._log.count

    def probe(self) -> str:
        """Empty where a new connection's frames are taken."""
        self._connect(BODIES)
        taken = self._counts["taken"]
        for _ in range(4):
            self._now_ns += STEP_NS
            self._session.received(self._exposure(sound_frame(self._now_ns)), self._now_ns)
            self._session.due(self._now_ns)
        return "" if self._counts["taken"] > taken and self._last.seen.any() else "a sound frame was not taken"

    def _connect(self, bodies: Sequence[str]) -> None:
        opened = self._source.open(self._now_ns, "127.0.0.1", "127.0.0.1")[0]
        self._session = getattr(opened, "vrpn", opened)  # without its timer
        for packet in self._server.opening(bodies):
            self._session.received(packet, self._now_ns)

    def _packet(self) -> bytes:
        draw = self._draw
        match draw.randrange(20):
            case 0:
                return draw.noise()
            case 1:
                return draw.choice(self._server.opening(draw.choices(TEXTS, k=draw.choice((0, 1, 2, 2, 20)))))
            case 2 | 3:
                return self._exposure(sound_frame(self._now_ns)) + self._exposure(sound_frame(self._now_ns))
        return self._exposure(self._frame())

    def _exposure(self, frame: RawFrame) -> bytes:
        self._number += self._draw.choice((1, 1, 1, 1, 2, 50))
        with np.errstate(all="ignore"):
            return self._server.exposure(frame, self._number)


class NatNetCamera(Camera):
    """A client of datagrams, by turns of a server of every version; after all of it a sound one is understood."""

    def __init__(self, draw: Draw, counts: Counter[str]) -> None:
        super().__init__(draw, counts, "natnet", host=HOST, multicast="")
        assert self._config.mocap.natnet is not None
        self._session = NatNetSession(self._config.mocap.natnet, 8 * STEP_NS, BODIES, self._feed)
        self._servers = [Responder(NatNetSettings(version=version), 1511, None) for version in VERSIONS]
        self._server = self._servers[0]
        self._session.start(self._now_ns)

    def feed(self) -> None:
        draw = self._draw
        self._now_ns += STEP_NS
        server = draw.choice(self._servers) if draw.random() < 0.2 else self._server
        asked = draw.choice((b"\0\0\0\0", b"\4\0\0\0", b"\x0c\0\x08\0" + draw.randbytes(8), b"\2\0\x0a\0Bitstream\0"))
        exposure, answers = self._exposure(server, self._frame()), server.received(asked, CLIENT, self._now_ns)
        data = draw.choice((exposure, exposure, *answers, draw.noise()))
        data = draw.spoiled(data, 0.8)
        if draw.random() < 0.9:
            data = data[:2] + (max(len(data) - 4, 0) & 0xFFFF).to_bytes(2, "little") + data[4:]
        self._session.received(data, HOST, self._now_ns)
        if draw.random() < 0.125:
            self._converse()
        self._counts["rejected"] = self._log.count

    def probe(self) -> str:
        """Empty where the next server's frames are taken within some seconds."""
        self._server = self._draw.choice(self._servers)
        for _ in range(PATIENCE):
            self._now_ns += STEP_NS
            self._converse()
            taken = self._counts["taken"]
            self._session.received(self._exposure(self._server, sound_frame(self._now_ns)), HOST, self._now_ns)
            if self._counts["taken"] > taken and self._last.bodies == BODIES:
                return ""
        return "sound frames are not taken any more"

    def _converse(self) -> None:
        """Send what is due, and take the answers."""
        for data in self._session.due(self._now_ns):
            for answer in self._server.received(data, CLIENT, self._now_ns):
                self._session.received(answer, HOST, self._now_ns)

    def _exposure(self, server: Responder, frame: RawFrame) -> bytes:
        self._number += 1
        with np.errstate(all="ignore"):
            return server.frame(replace(frame, seq=self._number), self._now_ns)


class Ros2Camera(Camera):
    """A subscriber to every type that it reads; after all of it a sound message is understood."""

    def __init__(self, draw: Draw, counts: Counter[str]) -> None:
        super().__init__(draw, counts, "ros2")
        self._source = Ros2Source(self._config, self._feed)
        self._types = [message_type(name) for name in (ARRAY, *POSE_AT)]

    def feed(self) -> None:
        draw, frame = self._draw, self._frame()
        self._now_ns += STEP_NS
        kind = draw.choice(self._types)
        data = draw.spoiled(kind.encode(_poses_of(kind, frame)), 0.7)
        name = draw.choice((kind, kind, kind, *self._types)).dds_name
        self._source.receive(draw.choice(frame.bodies or BODIES), name, data, self._now_ns)
        self._counts["rejected"] = self._log.count

    def probe(self) -> str:
        """Empty where sound messages are taken."""
        taken = self._counts["taken"]
        for k in range(PATIENCE):
            self._now_ns += 10 * STEP_NS
            sound = sound_frame(self._now_ns)
            moved = replace(sound, pos_mocap_m=sound.pos_mocap_m + 1e-6 * k)  # one that repeats is a lost body's
            data = self._types[0].encode(_poses_of(self._types[0], moved))
            self._source.receive("", self._types[0].dds_name, data, self._now_ns)
            if self._counts["taken"] > taken and self._last.seen.any():
                return ""
        return "sound messages are not taken any more"


def _poses_of(kind: MessageType, frame: RawFrame) -> Values:
    """A message of that type, of all bodies or of the first."""
    seconds, ns = divmod(frame.t_capture_ns, 1_000_000_000)
    head = (seconds % 2**31, ns, "world")
    rows = zip(frame.bodies, frame.pos_mocap_m.tolist(), frame.q_mocap_from_marker.tolist(), strict=True)
    poses = tuple((name, *pos, x, y, z, w) for name, pos, (w, x, y, z) in rows)
    if kind.name == ARRAY:
        return (*head, poses)
    pose = poses[0][1:] if poses else (0.0,) * 7
    return (*head, *pose) if POSE_AT[kind.name] == len(head) else (*head, "base", *pose, *(0.0,) * 78)


def sound_frame(now_ns: int) -> RawFrame:
    """Two bodies at rest."""
    q = np.tile([1.0, 0.0, 0.0, 0.0], (2, 1))
    return RawFrame(0, now_ns, BODIES, np.array([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]), q, np.ones(2, np.bool_))

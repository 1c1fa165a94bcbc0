"""A NatNet server as Motive is one: 3.0 to 4.2, multicast or unicast."""

import asyncio
import contextlib
import socket
from collections.abc import Mapping
from dataclasses import dataclass, field
from struct import Struct, pack, unpack_from

import numpy as np
from numpy.typing import NDArray

from formation.maths.arrays import Float
from formation.messages import RawFrame
from formation.mocap_config import MocapConfig, NatNetConfig
from wire.clock import Clock

Version = tuple[int, int]
MESSAGE = Struct("<HH")
SERVER_INFO, RESPONSE, MODELS, FRAME, ECHO_RESPONSE, UNRECOGNIZED = 1, 3, 5, 7, 13, 100
BODY = np.dtype([("id", "<i4"), ("pos", "<f4", 3), ("q_xyzw", "<f4", 4), ("error", "<f4"), ("params", "<i2")])
MARKER = np.dtype([("id", "<i4"), ("pos", "<f4", 3), ("size", "<f4"), ("params", "<i2"), ("residual", "<f4")])
SOLVED, HIDDEN = 0x0A, 0x09
"""A marker of a model: seen, or occluded."""
OFFSETS_M = np.array([[0.06, 0.0, 0.02], [-0.05, 0.03, 0.02], [-0.04, -0.05, 0.03], [0.0, 0.06, 0.04]])
"""Where each body's markers are on it; no two of its sides are alike."""
MARKER_SIZE_M, ERROR_M = 0.014, 0.0003
MOTIVE = {(3, 0): (2, 1), (3, 1): (2, 2), (4, 0): (3, 0), (4, 1): (3, 1), (4, 2): (3, 2)}
"""Which release streams which version of NatNet."""
ALL = "all"
"""The marker set of every marker."""


@dataclass(frozen=True, slots=True)
class Stamps:
    """A frame's stamps: seconds since the server's start, and ticks of its clock. exposure: 0 where unknown."""

    seconds: float
    exposure: int
    received: int
    transmit: int


def message(number: int, payload: bytes) -> bytes:
    """A packet."""
    return MESSAGE.pack(number, len(payload)) + payload


def server_info(name: str, version: Version, clock_hz: int, data_port: int, group: str | None) -> bytes:
    """The answer to CONNECT and DISCOVERY."""
    who = name.encode().ljust(256, b"\0") + bytes((*MOTIVE[version], 0, 0)) + bytes((*version, 0, 0))
    address = bytes(int(part) for part in (group or "0.0.0.0").split("."))
    return message(SERVER_INFO, who + pack("<QHB", clock_hz, data_port, group is not None) + address)


def models(bodies: Mapping[int, str], version: Version) -> bytes:
    """The answer to a request for models: of each body its marker set, then the set of all, then the bodies."""
    markers = range(1, len(OFFSETS_M) + 1)
    sets = {name: [f"Marker{k}" for k in markers] for name in bodies.values()}
    sets[ALL] = [f"{name}_{k}" for name in bodies.values() for k in markers]
    parts = [(0, _text(name) + pack("<i", len(of)) + b"".join(map(_text, of))) for name, of in sets.items()]
    parts += [(1, _body_model(number, name, version)) for number, name in bodies.items()]
    payload = pack("<i", len(parts))
    for kind, content in parts:
        payload += pack("<i", kind) + (pack("<i", len(content)) if version >= (4, 1) else b"") + content
    return message(MODELS, payload)


def _body_model(number: int, name: str, version: Version) -> bytes:
    """Name, id, no parent, no offset (from 4.2: nor rotation); markers: positions, active labels, from 4.0 names."""
    count = len(OFFSETS_M)
    rotation = pack("<4f", 0, 0, 0, 1) if version >= (4, 2) else b""
    names = b"".join(_text(f"Marker{k + 1}") for k in range(count)) if version >= (4, 0) else b""
    markers = pack("<i", count) + OFFSETS_M.astype("<f4").tobytes() + bytes(4 * count) + names
    return _text(name) + pack("<ii3f", number, -1, 0, 0, 0) + rotation + markers


def frame(
    number: int, bodies: NDArray[np.void], names: list[str], stamps: Stamps, params: int, version: Version
) -> bytes:
    """A frame of mocap data; `bodies` of BODY, with the name of each."""
    at_m = _markers_m(bodies)
    sections = (
        (len(names) + 1, _marker_sets(names, at_m)),
        (0, b""),
        (len(bodies), bodies.tobytes()),
        (0, b""),
        *([(0, b"")] if version >= (4, 1) else []),
        (at_m.shape[0] * at_m.shape[1], _markers(bodies, at_m)),
        (0, b""),
        (0, b""),
    )
    counted = version >= (4, 1)
    payload = b"".join(
        pack("<ii", count, len(content)) + content if counted else pack("<i", count) + content
        for count, content in sections
    )
    times = pack("<2Id3Q", 0, 0, stamps.seconds, stamps.exposure, stamps.received, stamps.transmit)
    precise = pack("<2I", 0, 0) if counted else b""
    return message(FRAME, pack("<i", number) + payload + times + precise + pack("<hI", params, 0))


def rows(raw: RawFrame, ids: list[int], unit_m: float) -> NDArray[np.void]:
    """A frame's bodies as BODY. One that is out of sight keeps the pose it is given, and is not marked as tracked."""
    bodies = np.zeros(len(ids), BODY)
    bodies["id"] = ids
    bodies["pos"] = raw.pos_mocap_m / unit_m
    bodies["q_xyzw"] = raw.q_mocap_from_marker[:, [1, 2, 3, 0]]
    bodies["error"] = ERROR_M / unit_m
    bodies["params"] = raw.seen
    return bodies


def _markers_m(bodies: NDArray[np.void]) -> Float:
    """Where every marker is (n, markers, 3)."""
    axis, w = bodies["q_xyzw"][:, None, :3], bodies["q_xyzw"][:, None, 3:]
    across = 2.0 * np.cross(axis, OFFSETS_M)
    return np.asarray(bodies["pos"][:, None, :] + OFFSETS_M + w * across + np.cross(axis, across), dtype="<f4")


def _marker_sets(names: list[str], at_m: Float) -> bytes:
    count = pack("<i", at_m.shape[1])
    each = b"".join(_text(name) + count + points.tobytes() for name, points in zip(names, at_m, strict=True))
    return each + _text(ALL) + pack("<i", at_m.shape[0] * at_m.shape[1]) + at_m.tobytes()


def _markers(bodies: NDArray[np.void], at_m: Float) -> bytes:
    """The labelled markers: the body's id in the upper half of theirs."""
    markers = np.zeros(at_m.shape[:2], MARKER)
    markers["id"] = (bodies["id"][:, None] << 16) + np.arange(1, at_m.shape[1] + 1)
    markers["pos"] = at_m
    markers["size"] = MARKER_SIZE_M
    markers["params"] = np.where(bodies["params"][:, None] & 1, SOLVED, HIDDEN)
    markers["residual"] = ERROR_M
    return markers.tobytes()


def _text(text: str) -> bytes:
    return text.encode()[:255] + b"\0"


Address = tuple[str, int]
CONNECT, REQUEST, REQUEST_MODELS, KEEP_ALIVE, ECHO_REQUEST, DISCOVERY = 0, 2, 4, 10, 12, 14
HEADER = 4
CLIENT_NS = 10_000_000_000
"""So long a unicast client is served after its last word."""
CLIENTS = 16
TRACKED_MODELS_CHANGED = 0x02
READOUT_NS = 2_000_000
"""From the middle of the exposure until Motive has the cameras' data."""


@dataclass(frozen=True, slots=True)
class NatNetSettings:
    """Settings that differ between one Motive and another.

    clock_hz, clock_s: the high-resolution clock's ticks a second, and what it shows more than ours. stamps: whether
    the cameras report the exposure time (Ethernet cameras do, USB cameras do not).
    """

    version: Version = (4, 1)
    clock_hz: int = 10_000_000
    clock_s: float = 7_200.0
    stamps: bool = True
    rate_hz: float = 100.0


@dataclass(slots=True)
class Responder:
    """One server. group: None for unicast. Bodies go by Motive's names."""

    settings: NatNetSettings
    data_port: int
    group: str | None
    unit_m: float = 1.0
    clients: dict[Address, int] = field(default_factory=dict)
    """When each unicast client was last heard."""
    clock_step_ns: int = 0
    """How much the clock was set since the start."""
    ids: dict[str, int] = field(default_factory=dict)
    """The streaming id of each body."""
    _last_id: int = 0
    changed: bool = False
    """Whether the next frame says that the models changed."""
    _t0_ns: int | None = None

    def ticks(self, t_ns: int) -> int:
        """The server's clock when ours shows t_ns."""
        shown_ns = t_ns + round(self.settings.clock_s * 1e9) + self.clock_step_ns
        return shown_ns * self.settings.clock_hz // 1_000_000_000

    def show(self, bodies: tuple[str, ...]) -> None:
        """The models are these now. One in another's place is that one renamed: it keeps the id."""
        if bodies == tuple(self.ids):
            return
        self.changed = bool(self.ids)
        if len(bodies) == len(self.ids):
            self.ids = dict(zip(bodies, self.ids.values(), strict=True))
            return
        known = self.ids
        self.ids = {}
        for name in bodies:
            if name not in known:
                self._last_id += 1
            self.ids[name] = known.get(name, self._last_id)

    def received(self, data: bytes, sender: Address, now_ns: int) -> list[bytes]:
        """A client's packet; what to answer it."""
        if len(data) < HEADER:
            return []
        kind, payload = int.from_bytes(data[:2], "little"), data[HEADER:]
        settings = self.settings
        match kind:
            case 0 | 14:
                if kind == CONNECT and self.group is None and (sender in self.clients or len(self.clients) < CLIENTS):
                    self.clients[sender] = now_ns
                info = server_info("Motive", settings.version, settings.clock_hz, self.data_port, self.group)
                return [info]
            case 4:
                return [models({number: name for name, number in self.ids.items()}, settings.version)]
            case 12 if len(payload) == 8:
                (theirs,) = unpack_from("<Q", payload)
                return [message(ECHO_RESPONSE, pack("<QQ", theirs, self.ticks(now_ns)))]
            case 2:
                return [self._answer(payload.partition(b"\0")[0])]
            case 10 if sender in self.clients:
                self.clients[sender] = now_ns
            case 9:
                self.clients.pop(sender, None)
        return []

    def frame(self, raw: RawFrame, now_ns: int) -> bytes:
        """The packet of an exposure, sent now."""
        self.show(raw.bodies)
        exposed_ns = raw.t_capture_ns or now_ns
        if self._t0_ns is None:
            self._t0_ns = exposed_ns
        stamps = Stamps(
            (exposed_ns - self._t0_ns) * 1e-9,
            self.ticks(exposed_ns) if self.settings.stamps else 0,
            self.ticks(min(exposed_ns + READOUT_NS, now_ns)) if self.settings.stamps else 0,
            self.ticks(now_ns),
        )
        params = TRACKED_MODELS_CHANGED if self.changed else 0
        self.changed = False
        bodies = rows(raw, list(self.ids.values()), self.unit_m)
        return frame(raw.seq & 0x7FFFFFFF, bodies, list(self.ids), stamps, params, self.settings.version)

    def listeners(self, now_ns: int) -> list[Address]:
        """Where frames go: the group, or who connected and is alive."""
        if self.group is not None:
            return [(self.group, self.data_port)]
        for client in [each for each, received_ns in self.clients.items() if now_ns - received_ns > CLIENT_NS]:
            del self.clients[client]
        return list(self.clients)

    def _answer(self, request: bytes) -> bytes:
        if request == b"FrameRate":
            return message(RESPONSE, pack("<f", self.settings.rate_hz))
        if request == b"Bitstream" and self.settings.version >= (4, 0):
            major, minor = self.settings.version
            return message(RESPONSE, f"Bitstream,{major}.{minor}.0\0".encode())
        return message(UNRECOGNIZED, b"")


READS_A_TURN = 32
LARGEST_PACKET = 65_536


class NatNetServer:
    """An emulated Motive server at `config.host`."""

    def __init__(self, config: NatNetConfig, responder: Responder, clock: Clock) -> None:
        self.responder = responder
        self._config = config
        self._clock = clock
        self._sockets: list[socket.socket] = []

    async def start(self) -> None:
        """Listen; OSError where an address is taken."""
        config = self._config
        command, data = (socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(2))
        self._sockets = [command, data]
        try:
            command.bind((config.host, config.command_port))
            if config.multicast:  # clients on this machine listen on the same port
                data.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
                data.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton(config.host))
            data.bind((config.host, config.data_port))
        except OSError:
            await self.close()
            raise
        for each in self._sockets:
            each.setblocking(False)
        asyncio.get_running_loop().add_reader(command, self._read, command)

    def publish(self, frame: RawFrame) -> None:
        """Send one exposure."""
        now_ns = self._clock.monotonic_ns()
        packet = self.responder.frame(frame, now_ns)
        for listener in self.responder.listeners(now_ns):
            with contextlib.suppress(OSError):  # no room, or nobody there: the next frame is worth more
                self._sockets[1].sendto(packet, listener)

    async def close(self) -> None:
        """Serve nobody any more."""
        for each in self._sockets:
            asyncio.get_running_loop().remove_reader(each)
            each.close()
        self._sockets = []
        self.responder.clients.clear()

    def _read(self, command: socket.socket) -> None:
        for _ in range(READS_A_TURN):
            try:
                data, sender = command.recvfrom(LARGEST_PACKET)
            except BlockingIOError:
                return
            except OSError:  # an ICMP answer to something sent earlier
                continue
            for answer in self.responder.received(data, sender, self._clock.monotonic_ns()):
                with contextlib.suppress(OSError):
                    command.sendto(answer, sender)


def natnet_server(
    config: MocapConfig, bodies: tuple[str, ...], clock: Clock, settings: NatNetSettings | None = None
) -> NatNetServer:
    """The server for a lab file's [mocap.natnet]; bodies by Motive's names."""
    table = config.natnet or NatNetConfig()
    settings = settings or NatNetSettings(rate_hz=config.rate_hz)
    responder = Responder(settings, table.data_port, table.multicast or None, config.unit_m)
    responder.show(bodies)
    return NatNetServer(table, responder, clock)

"""A VRPN server in a box, and Chingmu's manner of one."""

import asyncio
import contextlib
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import NamedTuple, Protocol, cast

import numpy as np

from formation.maths.arrays import Quat, Vec3
from formation.messages import RawFrame
from formation.mocap_config import FIRST_SENSOR, ChingmuConfig, MocapConfig, VrpnConfig
from mocap.sources.tcp import ProtocolError
from mocap.sources.vrpn import messages
from mocap.sources.vrpn.messages import Stream
from wire.clock import Clock

STAMP_STEP_NS = 10_000
"""Step between the stamps of successive trackers' poses in one exposure."""


class Report(NamedTuple):
    """One pose message: its sender, sensor, position in the server's unit, quaternion w x y z, stamp on top."""

    sender: str
    sensor: int
    pos: Vec3
    q: Quat
    later_ns: int


class ServerKind(Protocol):
    """One kind of VRPN server."""

    def senders(self, bodies: tuple[str, ...]) -> tuple[str, ...]:
        """The names of its senders, for these bodies of the lab."""

    def reports(self, frame: RawFrame) -> list[Report]:
        """The reports of one exposure, in the order of sending."""


@dataclass(frozen=True, slots=True)
class TrackerEach:
    """A tracker a body, sensor 0; of a body out of sight comes nothing."""

    unit_m: float

    def senders(self, bodies: tuple[str, ...]) -> tuple[str, ...]:
        """Their own names."""
        return bodies

    def reports(self, frame: RawFrame) -> list[Report]:
        """One a body in sight."""
        senders, pos = self.senders(frame.bodies), frame.pos_mocap_m / self.unit_m
        return [
            Report(senders[i], 0, pos[i], frame.q_mocap_from_marker[i], k * STAMP_STEP_NS)
            for k, i in enumerate(np.flatnonzero(frame.seen).tolist())
        ]


@dataclass(slots=True)
class SensorEach:
    """Chingmu: one device, a sensor a body; each pose is sent twice, and that of a lost body again and again."""

    unit_m: float
    device: str
    names: dict[str, str]
    """Bodies to the numbers of their sensors, where they are not the next free ones."""
    _numbers: dict[str, int] = field(default_factory=dict)
    _shown: dict[str, tuple[Vec3, Quat]] = field(default_factory=dict)

    def senders(self, bodies: tuple[str, ...]) -> tuple[str, ...]:
        """The device."""
        for body in bodies:
            self._number(body)
        return (self.device,)

    def reports(self, frame: RawFrame) -> list[Report]:
        """Two a body that was ever in sight."""
        pos = frame.pos_mocap_m / self.unit_m
        for i in np.flatnonzero(frame.seen).tolist():
            self._shown[frame.bodies[i]] = pos[i].copy(), frame.q_mocap_from_marker[i].copy()
        reports = []
        for body in frame.bodies:
            if body in self._shown:
                reports += 2 * [Report(self.device, self._number(body), *self._shown[body], 0)]
        return reports

    def _number(self, body: str) -> int:
        number = self._numbers.get(body)
        if number is None:
            named, number = self.names.get(body), FIRST_SENSOR
            used = {str(other) for other in self._numbers.values()}.union(self.names.values())
            while str(number) in used:
                number += 1
            number = self._numbers[body] = number if named is None else int(named)
        return number


SEND_BUFFER_MAX_BYTES = 1_000_000
"""The server drops a client with more unsent bytes than that."""
DATAGRAM_BYTES = 1400
TYPES = (messages.POSE_TYPE, messages.PING_TYPE, messages.PONG_TYPE)
"""The server's types, by number."""


class Names:
    """A server's identity: its cookie, its clock in ns, its senders by number."""

    def __init__(self, cookie: bytes, clock_ns: Callable[[], int]) -> None:
        self.cookie = cookie
        self.clock_ns = clock_ns
        self._numbers: dict[bytes, int] = {messages.CONTROL: 0}

    def number(self, name: bytes) -> int | None:
        """A sender's number; None of an unknown one."""
        return self._numbers.get(name)

    def add(self, names: Iterable[bytes]) -> bytes:
        """Add senders; returns the descriptions of the new ones."""
        descriptions = b""
        for name in names:
            if name not in self._numbers:
                self._numbers[name] = len(self._numbers)
                descriptions += messages.description(messages.SENDER_DESCRIPTION, self._numbers[name], name)
        return descriptions

    def all(self) -> bytes:
        """The descriptions that a new client gets: all senders and types."""
        senders = (
            messages.description(messages.SENDER_DESCRIPTION, number, name) for name, number in self._numbers.items()
        )
        types = (messages.description(messages.TYPE_DESCRIPTION, number, name) for number, name in enumerate(TYPES))
        return b"".join((*senders, *types))


class Connection(asyncio.Protocol):
    """A client, from its cookie on."""

    _transport: asyncio.Transport

    def __init__(self, names: Names, clients: set["Connection"], udp: asyncio.DatagramTransport) -> None:
        self._names = names
        self._clients = clients
        self._udp = udp
        self._udp_port: int | None = None
        self._cookie = b""
        self._stream = Stream()
        self._theirs: dict[tuple[int, int], bytes] = {}

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Both ends send their cookies at once."""
        self._transport = cast(asyncio.Transport, transport)
        self._transport.write(self._names.cookie)

    def data_received(self, data: bytes) -> None:
        """A client that does not speak VRPN is dropped."""
        try:
            if len(self._cookie) < messages.COOKIE_BYTES:
                missing = messages.COOKIE_BYTES - len(self._cookie)
                self._cookie, data = self._cookie + data[:missing], data[missing:]
                if len(self._cookie) < messages.COOKIE_BYTES:
                    return
                messages.check_cookie(self._cookie)
                self._transport.write(self._names.all())
                self._clients.add(self)
            for message in self._stream.messages(data):
                self._receive(message)
        except ProtocolError:
            self.drop()

    def connection_lost(self, exc: Exception | None) -> None:  # noqa: ARG002
        """It has gone."""
        self._clients.discard(self)

    def send_reliable(self, descriptions: bytes) -> None:
        """Send over TCP; a client that does not read is dropped."""
        if self._transport.get_write_buffer_size() > SEND_BUFFER_MAX_BYTES:
            self.drop()
        elif descriptions:
            self._transport.write(descriptions)

    def send(self, poses: list[bytes]) -> None:
        """Send pose messages by UDP, or over TCP if the client gave no UDP port."""
        if self._udp_port is None:
            self.send_reliable(b"".join(poses))
            return
        each = DATAGRAM_BYTES // len(poses[0]) if poses else 1
        to = self._transport.get_extra_info("peername")[0], self._udp_port
        for k in range(0, len(poses), each):
            self._udp.sendto(b"".join(poses[k : k + each]), to)

    def drop(self) -> None:
        """End it."""
        self._clients.discard(self)
        self._transport.abort()

    def _receive(self, message: messages.Message) -> None:
        kind, number = message.type, message.sender
        if kind in (messages.SENDER_DESCRIPTION, messages.TYPE_DESCRIPTION):
            if 0 <= number < messages.MOST_IDS:
                self._theirs[kind, number] = messages.described(message.payload)
        elif kind == messages.UDP_DESCRIPTION:
            self._udp_port = number if 0 < number < 65_536 else None
        elif self._theirs.get((messages.TYPE_DESCRIPTION, kind)) == messages.PING_TYPE:
            sender = self._names.number(self._theirs.get((messages.SENDER_DESCRIPTION, number), b""))
            if sender:
                self.send_reliable(messages.message(self._names.clock_ns(), sender, TYPES.index(messages.PONG_TYPE)))


CHINGMU_COOKIE = messages.COOKIE.replace(b"07.35", b"07.30")
CLOCK_NS = 1_790_000_000_000_000_000
"""Start of the server's clock against our clock's zero: some time in 2026, on a computer in no zone of ours."""
LOWEST_PORT = 1024
MOST_CALLS = 8
"""Clients that are being called back, at a time."""


@dataclass(frozen=True, slots=True)
class Address:
    """Where it listens, over TCP and UDP."""

    host: str
    port: int


def vrpn_server(config: MocapConfig, bodies: tuple[str, ...], clock: Clock) -> "VrpnServer":
    """A tracker a body."""
    at = (config.nokov if config.source == "nokov" else config.vrpn) or VrpnConfig()
    kind = TrackerEach(config.unit_m)
    return VrpnServer(Address(at.host, at.port), kind, bodies, messages.COOKIE, clock)


def chingmu_server(config: MocapConfig, bodies: tuple[str, ...], clock: Clock) -> "VrpnServer":
    """One device; the lab's bodies are sensors by `[mocap.names]`, the others in their order."""
    at = config.chingmu or ChingmuConfig()
    sensors = {body: number for number, body in config.names.items()}
    kind = SensorEach(config.unit_m, at.device, sensors)
    return VrpnServer(Address(at.host, at.port), kind, bodies, CHINGMU_COOKIE, clock)


class VrpnServer:
    """A `Server`. clock_ns: what its clock counts more than ours; may be set at any time, as people set clocks."""

    def __init__(
        self, address: Address, kind: ServerKind, bodies: tuple[str, ...], cookie: bytes, clock: Clock
    ) -> None:
        self.clock_ns = CLOCK_NS
        self._address = address
        self._kind = kind
        self._cookie = cookie
        self._bodies = bodies
        self._clock = clock
        self._clients: set[Connection] = set()
        self._calls: set[asyncio.Task[None]] = set()
        self._names = self._nameless()
        self._tcp: asyncio.Server | None = None
        self._udp: asyncio.DatagramTransport | None = None

    async def start(self) -> None:
        """Listen; OSError where an address is taken."""
        loop = asyncio.get_running_loop()
        host, port = self._address.host, self._address.port
        self._names = self._nameless()
        self._names.add(self._senders(self._bodies))
        self._udp, _ = await loop.create_datagram_endpoint(lambda: _Requests(self), local_addr=(host, port))
        try:
            self._tcp = await loop.create_server(self.connection, host, port)
        except OSError:
            self._udp.close()
            raise

    @property
    def port(self) -> int:
        """Where."""
        return self._address.port

    @property
    def clients(self) -> int:
        """How many are connected."""
        return len(self._clients)

    def publish(self, frame: RawFrame) -> None:
        """Send one exposure, metres, to whoever is connected."""
        descriptions = self._names.add(self._senders(frame.bodies))
        stamp_ns = frame.t_capture_ns + self.clock_ns
        poses = []
        for sender, sensor, pos, (w, x, y, z), later_ns in self._kind.reports(frame):
            payload = messages.POSE.pack(sensor, sensor, *pos, x, y, z, w)
            number = self._names.number(sender.encode()) or 0
            poses.append(messages.message(stamp_ns + later_ns, number, TYPES.index(messages.POSE_TYPE), payload))
        for client in tuple(self._clients):
            client.send_reliable(descriptions)
            client.send(poses)

    async def close(self) -> None:
        """End every connection and listen no more."""
        if self._tcp is not None:
            self._tcp.close()
        if self._udp is not None:
            self._udp.close()
        for call in self._calls:
            call.cancel()
        for client in tuple(self._clients):
            client.drop()
        await asyncio.sleep(0)  # aborted transports close when the loop comes round

    def connection(self) -> Connection:
        """A client that comes, or is called back."""
        assert self._udp is not None
        return Connection(self._names, self._clients, self._udp)

    def requested(self, data: bytes, sender: str) -> None:
        """A client asks, by "ADDRESS PORT", to be called back, which is done only at the address it asks from."""
        words = data.split(b"\0", 1)[0].split()
        if len(words) != 2 or not words[1].isdigit() or len(words[1]) > 5 or len(self._calls) >= MOST_CALLS:
            return
        port = int(words[1])
        if LOWEST_PORT <= port < 65_536:
            call = asyncio.ensure_future(self._call(sender, port))
            self._calls.add(call)
            call.add_done_callback(self._calls.discard)

    async def _call(self, host: str, port: int) -> None:
        with contextlib.suppress(OSError):  # it has gone meanwhile, and asks again if it has not
            await asyncio.get_running_loop().create_connection(self.connection, host, port)

    def _nameless(self) -> Names:
        return Names(self._cookie, lambda: self._clock.monotonic_ns() + self.clock_ns)

    def _senders(self, bodies: tuple[str, ...]) -> list[bytes]:
        return [name.encode() for name in self._kind.senders(bodies)]


class _Requests(asyncio.DatagramProtocol):
    def __init__(self, server: VrpnServer) -> None:
        self._server = server

    def datagram_received(self, data: bytes, addr: tuple[str, int]) -> None:
        self._server.requested(data, addr[0])

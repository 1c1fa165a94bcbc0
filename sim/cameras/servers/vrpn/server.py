"""The emulated VRPN server: listens over TCP, calls back clients that ask by datagram, sends poses to all."""

import asyncio
import contextlib
from dataclasses import dataclass

from formation.messages import RawFrame
from formation.mocap_config import ChingmuConfig, MocapConfig, VrpnConfig
from mocap.sources.vrpn import messages
from sim.cameras.servers.vrpn.connection import TYPES, Connection, Names
from sim.cameras.servers.vrpn.server_kind import SensorEach, ServerKind, TrackerEach
from wire.clock import Clock

CHINGMU_COOKIE = messages.COOKIE.replace(b"07.35", b"07.30")
CLOCK_NS = 1_790_000_000_000_000_000
"""What the server's clock counts from our clock's zero: some time in 2026, on a computer in no zone of ours."""
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
    at = config.vrpn or VrpnConfig()
    kind = TrackerEach(config.unit_m)
    return VrpnServer(Address(at.host, at.port), kind, bodies, messages.COOKIE, clock)


def chingmu_server(config: MocapConfig, bodies: tuple[str, ...], clock: Clock) -> "VrpnServer":
    """One device; the lab's bodies are sensors by `[mocap.names]`, the others in their order."""
    at = config.chingmu or ChingmuConfig()
    sensors = {body: number for number, body in config.names.items()}
    kind = SensorEach(config.unit_m, at.device, at.first_sensor, sensors)
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

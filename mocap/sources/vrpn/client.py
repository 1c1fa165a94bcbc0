"""The VRPN client: one TCP connection, a UDP socket beside it if wanted, and the time for frames that wait."""

import asyncio
import socket
from collections.abc import Callable
from dataclasses import replace

from formation.config import LabConfig
from formation.mocap_config import ChingmuConfig, VrpnConfig
from mocap.sources.source import Feed, SourceStatus, seconds
from mocap.sources.tcp import Session, TcpClient
from mocap.sources.vrpn import messages
from mocap.sources.vrpn.frames import Pacing
from mocap.sources.vrpn.session import Knowledge, Naming, Sensors, Trackers, VrpnSession

A_TURN = 64
LARGEST = 65_535
RECEIVE_BUFFER_BYTES = 1_000_000

Deliver = Callable[[list[tuple[bytes, str]]], None]


class Datagrams:
    """A bound socket (OSError where there is none to be had); deliver: takes datagrams and their senders' addresses."""

    def __init__(self, deliver: Deliver) -> None:
        self._deliver = deliver
        self._loop = asyncio.get_running_loop()
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER_BYTES)
        try:
            self._socket.bind(("0.0.0.0", 0))
        except OSError:
            self._socket.close()
            raise
        self._loop.add_reader(self._socket, self._read)

    @property
    def port(self) -> int:
        """Ours."""
        port: int = self._socket.getsockname()[1]
        return port

    def close(self) -> None:
        """Hear no more."""
        self._loop.remove_reader(self._socket)
        self._socket.close()

    def _read(self) -> None:
        came: list[tuple[bytes, str]] = []
        while len(came) < A_TURN:
            try:
                data, address = self._socket.recvfrom(LARGEST)
            except OSError:  # nothing waits
                break
            came.append((data, address[0]))
        if came:
            self._deliver(came)


def vrpn_source(config: LabConfig, feed: Feed) -> "VrpnSource":
    """Source `vrpn`."""
    server = config.mocap.vrpn or VrpnConfig()
    return VrpnSource(server, server.udp, _knowledge(config, server, Trackers(_bodies(config), feed.name), feed))


def chingmu_source(config: LabConfig, feed: Feed) -> "VrpnSource":
    """Source `chingmu`."""
    server = config.mocap.chingmu or ChingmuConfig()
    naming = Sensors(server, _bodies(config), config.mocap.names)
    return VrpnSource(server, False, _knowledge(config, server, naming, feed))


def _bodies(config: LabConfig) -> tuple[str, ...]:
    return tuple(vehicle.body for vehicle in config.vehicles)


def _knowledge(config: LabConfig, server: VrpnConfig | ChingmuConfig, naming: Naming, feed: Feed) -> Knowledge:
    return Knowledge(
        feed=feed,
        naming=naming,
        pacing=Pacing(1e9 / config.mocap.rate_hz),
        assemble_ns=round(server.assemble_s * 1e9),
        latency_ns=round(config.mocap.constant_latency_s * 1e9),
        repeats_are_lost=server.repeats_are_lost,
    )


class VrpnSource:
    """A `Source`."""

    def __init__(self, server: VrpnConfig | ChingmuConfig, udp: bool, known: Knowledge) -> None:
        self._known = known
        self._udp = udp
        self._receiver: Datagrams | None = None
        self._session: _Timed | None = None
        self._status = SourceStatus(server=f"{server.host}:{server.port}")
        self._client = TcpClient(server.host, server.port, self, known.feed)

    async def run(self) -> None:
        """Take frames until cancelled."""
        try:
            if self._udp:
                self._receiver = Datagrams(self.datagrams)
            await self._client.run()
        finally:
            if self._receiver is not None:
                self._receiver.close()

    def status(self) -> SourceStatus:
        """How it is doing."""
        lost, session = self._known.pacing.lost, self._session
        status = replace(self._status, connected=self._client.connected, lost=lost)
        if session is None:
            return status
        uncertainty_ns = session.vrpn.uncertainty_ns(self._known.feed.clock.monotonic_ns())
        return replace(
            status,
            latency_s=seconds(session.vrpn.latency_ns),
            uncertainty_s=seconds(uncertainty_ns),
            bodies=session.vrpn.bodies,
        )

    def open(self, now_ns: int, ours: str, theirs: str) -> tuple[Session, bytes]:
        """A new connection's session and cookie; where datagrams are to go, if they are wanted."""
        if self._session is not None:
            self._session.stop()
        hello = messages.COOKIE
        if self._receiver is not None:
            hello += messages.udp_description(ours, self._receiver.port)
        self._session = _Timed(VrpnSession(self._known, now_ns), self._known.feed, theirs)
        return self._session, hello

    def datagrams(self, came: list[tuple[bytes, str]]) -> None:
        """From the server that we are connected to; others are not heard."""
        session = self._session
        server = session.server if session is not None else ""
        theirs = [data for data, sender in came if sender == server]
        if len(theirs) < len(came):
            self._known.feed.reject("datagram of somebody else", len(came) - len(theirs))
        if session is not None and theirs:
            session.datagrams(theirs)


class _Timed:
    """A session that is woken when a frame has waited long enough."""

    def __init__(self, vrpn: VrpnSession, feed: Feed, server: str) -> None:
        self.vrpn = vrpn
        self.server = server
        self._feed = feed
        self._timer: asyncio.TimerHandle | None = None

    def received(self, data: bytes, now_ns: int) -> bytes:
        answer = self.vrpn.received(data, now_ns)
        self._set()
        return answer

    def due(self, now_ns: int) -> bytes:
        return self.vrpn.due(now_ns)

    def datagrams(self, came: list[bytes]) -> None:
        self.vrpn.datagrams(came, self._feed.clock.monotonic_ns())
        self._set()

    def stop(self) -> None:
        """No frame comes of it any more."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def _set(self) -> None:
        due_ns = self.vrpn.due_ns
        if due_ns is not None and self._timer is None:
            delay_s = self._feed.clock.seconds_until(due_ns)
            self._timer = asyncio.get_running_loop().call_later(delay_s, self._expire)

    def _expire(self) -> None:
        self._timer = None
        self.vrpn.expire(self._feed.clock.monotonic_ns())
        self._set()

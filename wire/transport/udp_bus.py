"""MAVLink over UDP, PX4's port habit: the ground has one socket a drone, so that no drone hears another's packets.

The drone `sysid` binds drone_port_base + sysid and sends to ground_port_base + sysid; the ground does the reverse.
Sockets are read straight from the event loop, which costs a third of asyncio's datagram transports. The kernel gives a
datagram to the socket that is connected to its sender, where there is one: so the expected peer has a socket and buffer
of its own (`bind_port`), which no flood of others fills. They are bound to loopback, or, for a peer on another machine,
to the one address of this machine that leads there. Where the drone has a key, packets are signed here and verified
before their sender is looked at.
"""

import asyncio
import select
import socket
from collections.abc import Iterable
from typing import NamedTuple

from formation.exposure import is_loopback
from formation.link_config import LinkConfig
from formation.messages import Datagram
from wire import clock
from wire.mavlink.framing import LARGEST_DATAGRAM, MAGIC_1, MAGIC_2, FrameCutter
from wire.mavlink.signing import SigningChannel
from wire.rejections import RejectionLog
from wire.security.bus_access import address_towards
from wire.security.protection import LOOPBACK_ONLY, Protection
from wire.transport.link import PAUSE_S, READS_A_TURN, Deliver, Intake, LinkCounters

SocketAddress = tuple[str, int]

QUIET_NS = 1_000_000_000


class PeerFilter:
    """Accepts or rejects each datagram by its sender, before anything parses it.

    `expected`: the drone's own address; None where the drone chooses it. The filter accepts another sender only after
    a second without datagrams, and only if it sends MAVLink of system `sysid`. Such a sender is the drone on a new
    port, or behind another address.
    """

    def __init__(self, sysid: int, expected: SocketAddress | None) -> None:
        self.current = expected
        """The address to answer: the expected one, or the newest accepted one; None before the first."""
        self._sysid = sysid
        self._expected = expected
        self._received_ns: int | None = None

    def reject_reason(self, sender: SocketAddress, data: bytes, now_ns: int) -> str:
        """Why the filter rejects this datagram, one of a few texts; empty where it accepts it."""
        if sender != self._expected and sender != self.current:
            if self._received_ns is not None and now_ns - self._received_ns < QUIET_NS:
                return f"datagram at the port of drone {self._sysid}, from another address"
            if not self._speaks_as_drone(data):
                return f"datagram at the port of drone {self._sysid}, no MAVLink of that system"
        self.current, self._received_ns = sender, now_ns
        return ""

    def _speaks_as_drone(self, data: bytes) -> bool:
        """Whether it has a valid MAVLink packet of system `sysid`; the header is checked first, which is cheap."""
        system_at = 5 if data[:1] == b"\xfd" else 3
        if len(data) <= system_at or data[0] not in (MAGIC_1, MAGIC_2) or data[system_at] != self._sysid:
            return False
        return any(frame.source.system == self._sysid for frame in FrameCutter().cut(data))


PEER_BUFFER = 1 << 20
"""Bytes that may wait of the peer: seconds of its packets. A kernel that allows less gives less."""


class PortSockets(NamedTuple):
    """peer: hears the peer alone; None where it is not known. others: hears everybody else, and sends."""

    peer: socket.socket | None
    others: socket.socket

    @property
    def both(self) -> tuple[socket.socket, ...]:
        """Those that there are, the peer's first."""
        return (self.others,) if self.peer is None else (self.peer, self.others)

    def close(self) -> None:
        """Close both."""
        self.others.close()
        if self.peer is not None:
            self.peer.close()


def bind_port(bind: SocketAddress, peer: SocketAddress | None) -> PortSockets:
    """Bind a port, which nobody else may share. OSError where it is taken, or where no route leads to the peer."""
    others = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    others.setblocking(False)
    own: socket.socket | None = None
    try:
        others.bind(bind)
        if peer is not None:
            own = _connected(others, peer)
    except OSError:
        others.close()
        raise
    return PortSockets(own, others)


def _connected(others: socket.socket, peer: SocketAddress) -> socket.socket:
    """A second socket of the same port. The port is shared between two binds alone: no other process may join."""
    own = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        own.setblocking(False)
        own.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, PEER_BUFFER)
        others.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEPORT, 1)
        own.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEPORT, 1)
        own.bind(others.getsockname())
        own.connect(peer)
    except OSError:
        own.close()
        raise
    finally:
        for each in (others, own):
            if each.fileno() >= 0:
                each.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEPORT, 0)
    return own


OTHERS_A_TURN = 32
"""Datagrams of others than the peer that are read at once: 0.2 ms of work, in which the peer's wait."""
_TALKERS = 4
TOO_LARGE = f"datagram larger than {LARGEST_DATAGRAM} bytes"


class _Port:
    """One port of one drone's traffic, with its peer and the other recent senders.

    `peer_filter` accepts or rejects senders. Without one, every sender is accepted, and the latest `_TALKERS` senders
    of MAVLink get all packets too: any ground station may talk to a drone. `channel` signs and verifies: a sender is
    learnt from a verified packet only.
    """

    def __init__(
        self,
        bind: SocketAddress,
        peer: SocketAddress | None,
        peer_filter: PeerFilter | None,
        sysid: int,
        deliver: Deliver,
        counters: LinkCounters,
        rejections: RejectionLog,
        channel: SigningChannel | None = None,
    ) -> None:
        """Bind (OSError)."""
        self._channel = channel
        self._peer = peer
        self._peer_filter = peer_filter
        self._talkers: dict[SocketAddress, None] = {}
        self._intake = Intake(sysid, deliver, counters)
        self._counters = counters
        self._rejections = rejections
        self._loop = asyncio.get_running_loop()
        self._resume: dict[socket.socket, asyncio.TimerHandle] = {}
        self._sockets = bind_port(bind, peer)
        # Of these two, not of each: uvloop hears no more of a socket to which an ICMP error has come.
        self._ready = select.epoll()
        for each in self._sockets.both:
            self._ready.register(each, select.EPOLLIN)
        self._loop.add_reader(self._ready.fileno(), self._turn)

    def send(self, data: bytes) -> None:
        if self._channel is not None:
            data = self._channel.sign(data, clock.unix_us())
            if not data:
                return
        for peer in self._audience():
            try:
                self._sockets.others.sendto(data, peer)
                self._counters.sent += 1
            except OSError:  # no room, or nobody there: the next setpoint is worth more than this one
                self._counters.dropped += 1

    def close(self) -> None:
        self._intake.close()
        for handle in self._resume.values():
            handle.cancel()
        self._loop.remove_reader(self._ready.fileno())
        self._ready.close()
        self._sockets.close()

    def _audience(self) -> tuple[SocketAddress, ...]:
        peer = self._peer
        if peer is None and self._peer_filter is not None:
            peer = self._peer_filter.current
        return tuple(self._talkers) if peer is None else (peer, *self._talkers)

    def _turn(self) -> None:
        """Read the peer's packets before those of others."""
        for source in self._sockets.both:
            if source not in self._resume:
                self._read(source, OTHERS_A_TURN if source is self._sockets.others else READS_A_TURN)

    def _read(self, source: socket.socket, reads_most: int) -> None:
        """Read what has arrived at one socket, so much of it; a flood waits while others have their turn."""
        for _ in range(reads_most):
            try:
                data, sender = source.recvfrom(LARGEST_DATAGRAM + 1)
            except BlockingIOError:
                return
            except OSError:  # an ICMP answer to something sent earlier
                continue
            now_ns = clock.monotonic_ns()
            if self._channel is not None and len(data) <= LARGEST_DATAGRAM:
                data = self._verified(self._channel, data, sender, now_ns)
                if not data:
                    continue
            reject_reason = self._reject_reason(data, sender, now_ns)
            if reject_reason:
                self._counters.rejected += 1
                self._rejections.note(sender[0], reject_reason, now_ns)
                continue
            self._counters.received += 1
            if self._peer_filter is None and sender != self._peer and data[:1] and data[0] in (MAGIC_1, MAGIC_2):
                self._note(sender)
            self._intake.enqueue(data)
        self._ready.unregister(source)
        self._resume[source] = self._loop.call_later(PAUSE_S, self._resume_reading, source)

    def _resume_reading(self, source: socket.socket) -> None:
        del self._resume[source]
        self._ready.register(source, select.EPOLLIN)

    def _verified(self, channel: SigningChannel, data: bytes, sender: SocketAddress, now_ns: int) -> bytes:
        """The datagram's verified packets; the others are counted."""
        verified = channel.verify(data, clock.unix_us())
        if verified.reject_reason:
            self._counters.rejected += 1
            self._rejections.note(sender[0], verified.reject_reason, now_ns)
        return verified.data

    def _reject_reason(self, data: bytes, sender: SocketAddress, now_ns: int) -> str:
        """Why this datagram is rejected; empty where it is not."""
        if len(data) > LARGEST_DATAGRAM:
            return TOO_LARGE
        return "" if self._peer_filter is None else self._peer_filter.reject_reason(sender, data, now_ns)

    def _note(self, sender: SocketAddress) -> None:
        """Keep the most recent senders, the oldest first."""
        self._talkers.pop(sender, None)
        if len(self._talkers) >= _TALKERS:
            del self._talkers[next(iter(self._talkers))]
        self._talkers[sender] = None


class UdpLink:
    """The sockets of one process, by drone."""

    def __init__(self, ports: dict[int, _Port], counters: LinkCounters) -> None:
        self.counters = counters
        self._ports = ports

    def send(self, datagram: Datagram) -> None:
        """Send to the peers of the drone `sysid`; KeyError for a drone that is none of this link's."""
        self._ports[datagram.sysid].send(datagram.data)

    def close(self) -> None:
        """Close every socket."""
        for port in self._ports.values():
            port.close()
        self._ports.clear()


async def open_udp_ground(
    config: LinkConfig,
    sysids: Iterable[int],
    deliver: Deliver,
    rejections: RejectionLog,
    protection: Protection = LOOPBACK_ONLY,
) -> UdpLink:
    """The ground's end: one socket a drone. OSError where a port is taken, the host is unknown or not authenticated."""
    sysids, host = tuple(sysids), await _resolve(config.host)
    for sysid in sysids:
        protection.demand_host("link.host", host, sysid)
    ports: dict[int, _Port] = {}
    link = UdpLink(ports, LinkCounters())
    try:
        for sysid in sysids:
            bind = (_bind_host(host), config.ground_port_base + sysid)
            peer = (host, config.drone_port_base + sysid)
            channel = protection.channel(sysid)
            ports[sysid] = _Port(
                bind, peer, PeerFilter(sysid, peer), sysid, deliver, link.counters, rejections, channel
            )
    except OSError:
        link.close()
        raise
    return link


async def open_udp_drone(
    config: LinkConfig,
    sysid: int,
    deliver: Deliver,
    rejections: RejectionLog,
    protection: Protection = LOOPBACK_ONLY,
) -> UdpLink:
    """The drone's end: sends to the ground's port, and to whoever else has spoken MAVLink to it of late. OSError."""
    host = await _resolve(config.host)
    protection.demand_host("link.host", host, sysid)
    bind = (_bind_host(host), config.drone_port_base + sysid)
    peer = (host, config.ground_port_base + sysid)
    counters = LinkCounters()
    port = _Port(bind, peer, None, sysid, deliver, counters, rejections, protection.channel(sysid))
    return UdpLink({sysid: port}, counters)


def direct_address(link: str) -> tuple[str, str, int]:
    """Kind, host and port of "udp:HOST:PORT", "udpin:..." or "udpout:..."; ValueError for text that is none."""
    kind, _, where = link.partition(":")
    host, _, port = where.rpartition(":")
    if kind not in ("udp", "udpin", "udpout") or not host or not port.isdecimal() or not 0 < int(port) < 65536:
        raise ValueError(f"{link!r} is not udp:HOST:PORT, udpin:HOST:PORT or udpout:HOST:PORT")
    return kind, host, int(port)


async def open_udp_direct(
    link: str, sysid: int, deliver: Deliver, rejections: RejectionLog, protection: Protection = LOOPBACK_ONLY
) -> UdpLink:
    """A link to one autopilot's own telemetry port. Raises OSError, and ValueError for text that is no such link.

    link: "udp:HOST:PORT" or "udpout:HOST:PORT" sends there; "udpin:HOST:PORT" binds there and answers the drone that
    speaks there. Autopilots answer the port that first spoke to them, PX4 for its whole life: what sends there sends
    from the same port in every run, where that is free.
    """
    kind, host, port = direct_address(link)
    address = (await _resolve(host), port)
    protection.demand_host("link", f"{address[0]}", sysid)
    counters, channel = LinkCounters(), protection.channel(sysid)

    def bound(bind: SocketAddress, peer: SocketAddress | None) -> _Port:
        return _Port(bind, peer, PeerFilter(sysid, peer), sysid, deliver, counters, rejections, channel)

    if kind == "udpin":
        endpoint = bound(address, None)
    else:
        own_host = _bind_host(address[0])
        try:
            endpoint = bound((own_host, 14800 + sysid), address)
        except OSError:
            endpoint = bound((own_host, 0), address)
    return UdpLink({sysid: endpoint}, counters)


async def _resolve(host: str) -> str:
    """The IPv4 address of a host's name."""
    loop = asyncio.get_running_loop()
    found = await loop.getaddrinfo(host, None, family=socket.AF_INET, type=socket.SOCK_DGRAM)
    return str(found[0][4][0])


def _bind_host(peer_host: str) -> str:
    """Loopback for a peer on this machine, else the one address of this machine that leads to the peer. OSError."""
    return "127.0.0.1" if is_loopback(peer_host) else address_towards(peer_host)

"""MAVLink over UDP, PX4's port habit: the ground has one socket a drone, so that no drone hears another's packets.

The drone `sysid` binds drone_port_base + sysid and sends to ground_port_base + sysid; the ground does the reverse.
Sockets are read straight from the event loop, which costs a third of asyncio's datagram transports.
"""

import asyncio
import socket
from collections.abc import Iterable

from formation.config import LinkConfig
from formation.messages import Datagram
from wire.link import Deliver, LinkCounters

SocketAddress = tuple[str, int]

_MAGICS = (0xFD, 0xFE)
_LARGEST = 65536
_READS_A_WAKE = 64  # a flood on one socket must not starve the rest of the loop
_TALKERS = 4
_DIRECT_PORT_BASE = 14800


class _Port:
    """One bound socket of one drone's traffic: where it sends, and who else has talked to it.

    `talkers`: how many other senders of MAVLink are answered, the most recent ones.
    """

    def __init__(
        self,
        bind: SocketAddress,
        peers: Iterable[SocketAddress],
        talkers: int,
        sysid: int,
        deliver: Deliver,
        counters: LinkCounters,
    ) -> None:
        """Bind (OSError)."""
        self._peers = tuple(peers)
        self._talkers: dict[SocketAddress, None] = {}
        self._most_talkers = talkers
        self._sysid = sysid
        self._deliver = deliver
        self._counters = counters
        self._loop = asyncio.get_running_loop()
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        try:
            self._socket.bind(bind)
        except OSError:
            self._socket.close()
            raise
        self._loop.add_reader(self._socket, self._read)

    def send(self, data: bytes) -> None:
        for peer in (*self._peers, *self._talkers):
            try:
                self._socket.sendto(data, peer)
                self._counters.sent += 1
            except OSError:  # no room, or nobody there: the next setpoint is worth more than this one
                self._counters.dropped += 1

    def close(self) -> None:
        self._loop.remove_reader(self._socket)
        self._socket.close()

    def _read(self) -> None:
        for _ in range(_READS_A_WAKE):
            try:
                data, sender = self._socket.recvfrom(_LARGEST)
            except BlockingIOError:
                return
            except OSError:  # an ICMP answer to something sent earlier
                continue
            if self._most_talkers and sender not in self._peers and data[:1] and data[0] in _MAGICS:
                self._note(sender)
            self._counters.received += 1
            self._deliver(Datagram(self._sysid, data))

    def _note(self, sender: SocketAddress) -> None:
        """Keep the most recent senders, the oldest first."""
        self._talkers.pop(sender, None)
        if len(self._talkers) >= self._most_talkers:
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


async def open_udp_ground(config: LinkConfig, sysids: Iterable[int], deliver: Deliver) -> UdpLink:
    """The ground's end: one socket a drone. OSError where a port is taken or the host is unknown."""
    host = await _resolve(config.host)
    ports: dict[int, _Port] = {}
    link = UdpLink(ports, LinkCounters())
    try:
        for sysid in sysids:
            bind = (_bind_host(host), config.ground_port_base + sysid)
            peer = (host, config.drone_port_base + sysid)
            ports[sysid] = _Port(bind, [peer], 0, sysid, deliver, link.counters)
    except OSError:
        link.close()
        raise
    return link


async def open_udp_drone(config: LinkConfig, sysid: int, deliver: Deliver) -> UdpLink:
    """The drone's end: sends to the ground's port, and to whoever else has spoken MAVLink to it of late. OSError."""
    host = await _resolve(config.host)
    bind = (_bind_host(host), config.drone_port_base + sysid)
    peer = (host, config.ground_port_base + sysid)
    counters = LinkCounters()
    return UdpLink({sysid: _Port(bind, [peer], _TALKERS, sysid, deliver, counters)}, counters)


async def open_udp_direct(link: str, sysid: int, deliver: Deliver) -> UdpLink:
    """A link to one autopilot's own telemetry port. Raises OSError, and ValueError for text that is no such link.

    link: "udp:HOST:PORT" or "udpout:HOST:PORT" sends there; "udpin:HOST:PORT" binds there and answers the last sender.
    Autopilots answer the port that first spoke to them, PX4 for its whole life: what sends there sends from the same
    port in every run, where that is free.
    """
    kind, _, where = link.partition(":")
    host, _, port = where.rpartition(":")
    if kind not in ("udp", "udpin", "udpout") or not host or not port.isdecimal() or not 0 < int(port) < 65536:
        raise ValueError(f"{link!r} is not udp:HOST:PORT, udpin:HOST:PORT or udpout:HOST:PORT")
    address = (await _resolve(host), int(port))
    counters = LinkCounters()
    if kind == "udpin":
        endpoint = _Port(address, [], 1, sysid, deliver, counters)
    else:
        own_host = _bind_host(address[0])
        try:
            endpoint = _Port((own_host, _DIRECT_PORT_BASE + sysid), [address], 0, sysid, deliver, counters)
        except OSError:
            endpoint = _Port((own_host, 0), [address], 0, sysid, deliver, counters)
    return UdpLink({sysid: endpoint}, counters)


async def _resolve(host: str) -> str:
    """The IPv4 address of a host's name."""
    loop = asyncio.get_running_loop()
    found = await loop.getaddrinfo(host, None, family=socket.AF_INET, type=socket.SOCK_DGRAM)
    return str(found[0][4][0])


def _bind_host(peer_host: str) -> str:
    """Loopback for a peer on this machine, else every interface."""
    return "127.0.0.1" if peer_host.startswith("127.") else "0.0.0.0"

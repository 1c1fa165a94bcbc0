"""Which camera systems answer in this network: NatNet and QTM are asked by broadcast, VRPN and Vicon at given hosts.

NatNet: message 14 to port 1510. QTM: the discovery packet of the RT protocol to port 22226. The others have no such
thing: their TCP ports are tried; a VRPN server says what it is, of a Vicon server only the open port is seen.
"""

import asyncio
import contextlib
import json
import socket
import sys
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass, field
from struct import Struct
from typing import cast

from rich.console import Console
from rich.table import Table
from rich.text import Text

from mocap.sources.natnet import packets
from mocap.sources.natnet.packets import MessageId, PacketError
from mocap.sources.vrpn.messages import COOKIE_BYTES
from wire.text import plain

BROADCAST = "255.255.255.255"
LONGEST = 128
COOKIE = b"vrpn: ver. "

_QTM_HEADER = Struct("<II")
_QTM_PORT = Struct(">H")
QTM_COMMAND, QTM_DISCOVER = 1, 7


@dataclass(frozen=True, slots=True, order=True)
class Finding:
    """A camera system: the `source` of lab.toml, where it is, what it calls itself; empty where it does not say."""

    protocol: str
    address: str
    name: str = ""
    version: str = ""


@dataclass(frozen=True, slots=True)
class Ports:
    """Where each is asked for."""

    natnet: int = 1510
    qtm: int = 22226
    vrpn: tuple[int, ...] = (3883, 3884)
    vicon: int = 801


def natnet_request() -> bytes:
    """The NatNet servers that answer, with their information."""
    return packets.hello(MessageId.DISCOVERY, "mavlink-formation")


def natnet_finding(data: bytes, address: str) -> Finding | None:
    """A NatNet server's answer; None for anything else."""
    try:
        kind, payload = packets.unpack(data)
        if kind != MessageId.SERVER_INFO:
            return None
        info = packets.server_info(payload)
    except PacketError:
        return None
    app = ".".join(str(number) for number in info.app_version)
    transmission = f"multicast {info.multicast}" if info.multicast else "unicast"
    version = f"NatNet {info.version[0]}.{info.version[1]}, {transmission}"
    return Finding("natnet", address, plain(f"{info.name} {app}", LONGEST), version)


def qtm_request(answer_port: int) -> bytes:
    """The QTM servers that answer to that UDP port of ours."""
    return _QTM_HEADER.pack(_QTM_HEADER.size + _QTM_PORT.size, QTM_DISCOVER) + _QTM_PORT.pack(answer_port)


def qtm_finding(data: bytes, address: str) -> Finding | None:
    """A QTM server's answer, "name, QTM version, cameras" and the RT server's base port; None for anything else."""
    if len(data) < _QTM_HEADER.size + 1 + _QTM_PORT.size:
        return None
    size, kind = _QTM_HEADER.unpack_from(data)
    if size != len(data) or kind != QTM_COMMAND:
        return None
    (port,) = _QTM_PORT.unpack_from(data, size - _QTM_PORT.size)
    text = data[_QTM_HEADER.size : size - _QTM_PORT.size].partition(b"\0")[0].decode("utf-8", "replace")
    name, _, version = plain(text, LONGEST).partition(",")
    return Finding("qualisys", f"{address}:{port}", name.strip(), version.strip())


def vrpn_finding(cookie: bytes, address: str) -> Finding | None:
    """The version in a VRPN server's first bytes; None for anything else."""
    if not cookie.startswith(COOKIE):
        return None
    words = cookie[len(COOKIE) :].decode("ascii", "replace").split()
    return Finding("vrpn", address, "", plain(words[0].strip("\0"), LONGEST)) if words else None


@dataclass(slots=True)
class _Asker(asyncio.DatagramProtocol):
    """Sends a question to many, and takes the answers that come."""

    request: Callable[[int], bytes]
    parse: Callable[[bytes, str], Finding | None]
    where: Sequence[tuple[str, int]]
    found: set[Finding] = field(default_factory=set)

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Ask everybody."""
        question = self.request(transport.get_extra_info("sockname")[1])
        for address in self.where:
            with contextlib.suppress(OSError):
                cast(asyncio.DatagramTransport, transport).sendto(question, address)

    def datagram_received(self, data: bytes, addr: tuple[str, int]) -> None:
        """Somebody answers."""
        finding = self.parse(data, addr[0])
        if finding is not None and len(self.found) < 256:
            self.found.add(finding)

    def error_received(self, exc: Exception) -> None:
        """Nobody there, or no way there."""


async def discover(hosts: Sequence[str] = (), wait_s: float = 1.0, ports: Ports | None = None) -> list[Finding]:
    """The servers that answer within `wait_s`, by broadcast and at `hosts`; in order."""
    ports = ports or Ports()
    everywhere = dict.fromkeys((BROADCAST, *broadcasts(), *await _addresses(hosts, wait_s)))
    natnet = _Asker(lambda _: natnet_request(), natnet_finding, [(each, ports.natnet) for each in everywhere])
    qtm = _Asker(qtm_request, qtm_finding, [(each, ports.qtm) for each in everywhere])
    probes = [_tcp(host, port, COOKIE_BYTES, wait_s) for host in hosts for port in ports.vrpn]
    probes += [_tcp(host, ports.vicon, 0, wait_s) for host in hosts]
    answers = await asyncio.gather(*probes, _ask(natnet, wait_s), _ask(qtm, wait_s))
    found = natnet.found | qtm.found | {finding for finding in answers if finding is not None}
    return sorted(found)


def broadcasts() -> list[str]:
    """The broadcast address of each network of this machine, where the system reports it (Linux)."""
    found = []
    with contextlib.suppress(ImportError), socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        from fcntl import ioctl

        for _, name in socket.if_nameindex():
            with contextlib.suppress(OSError):
                # SIOCGIFBRDADDR
                reply = ioctl(probe, 0x8919, name.encode()[:15].ljust(256, b"\0"))
                found.append(socket.inet_ntoa(reply[20:24]))
    return [address for address in found if address != "0.0.0.0"]


async def _addresses(hosts: Iterable[str], wait_s: float) -> list[str]:
    """IPv4 addresses; a name that is not resolved in time is left out."""

    async def resolve(host: str) -> str | None:
        with contextlib.suppress(OSError, TimeoutError):
            async with asyncio.timeout(wait_s):
                found = await asyncio.get_running_loop().getaddrinfo(host, None, family=socket.AF_INET)
                return str(found[0][4][0])
        return None

    return [address for address in await asyncio.gather(*map(resolve, hosts)) if address is not None]


async def _ask(asker: _Asker, wait_s: float) -> None:
    with contextlib.suppress(OSError):
        transport, _ = await asyncio.get_running_loop().create_datagram_endpoint(
            lambda: asker, local_addr=("0.0.0.0", 0), allow_broadcast=True
        )
        try:
            await asyncio.sleep(wait_s)
        finally:
            transport.close()


async def _tcp(host: str, port: int, greeting_bytes: int, wait_s: float) -> Finding | None:
    """The server that listens there. greeting_bytes: how many bytes it sends first; 0 where an open port suffices."""
    address = f"{host}:{port}"
    with contextlib.suppress(OSError, TimeoutError, asyncio.IncompleteReadError):
        async with asyncio.timeout(wait_s):
            reader, writer = await asyncio.open_connection(host, port)
            try:
                return (
                    vrpn_finding(await reader.readexactly(greeting_bytes), address)
                    if greeting_bytes
                    else Finding("vicon", address)
                )
            finally:
                writer.close()
    return None


def print_discovered(hosts: tuple[str, ...], as_json: bool, wait_s: float = 2.0) -> None:
    """Ask, wait, and print the servers that answered; none is no error."""
    print(f"gcs: asking the network, and {len(hosts)} hosts, for {wait_s:g} s", file=sys.stderr)
    found = asyncio.run(discover(hosts, wait_s))
    if as_json:
        print(json.dumps([asdict(finding) for finding in found]))
        return
    if not found:
        print("no camera system answered: name its computer as well, `gcs mocap discover HOST`")
        return
    table = Table(box=None, pad_edge=False)
    for column in ("source", "address", "name", "version"):
        table.add_column(column, no_wrap=True)
    for finding in found:
        table.add_row(*map(Text, (finding.protocol, finding.address, finding.name, finding.version)))
    Console().print(table)

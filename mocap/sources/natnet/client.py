"""NatNet's sockets: one for commands, and the frames of a unicast server; one for multicast, or port 1511."""

import asyncio
import contextlib
import socket
from collections.abc import Iterator

from formation.config import LabConfig
from formation.messages import Severity
from formation.mocap_config import NatNetConfig
from mocap.sources.natnet.session import NatNetSession
from mocap.sources.source import Feed, SourceStatus

TURN_NS = 25_000_000
LARGEST_PACKET = 65_536
BUFFER_BYTES = 4 * 1024 * 1024
"""What the kernel may keep while we are busy, as far as the system allows."""
AGAIN_NS = 500_000_000
RESOLVE_S = 2.0
ANY = "0.0.0.0"


class NatNet:
    """Motive as a source. It reopens its sockets when the server is silent, to find a network that was away."""

    def __init__(self, config: LabConfig, feed: Feed) -> None:
        self._config = config.mocap.natnet or NatNetConfig()
        self._feed = feed
        self._reported = ""
        latency_ns = round(config.mocap.constant_latency_s * 1e9)
        self._session = NatNetSession(self._config, latency_ns, [v.body for v in config.vehicles], feed)

    def status(self) -> SourceStatus:
        """How it is doing."""
        return self._session.status()

    async def run(self) -> None:
        """Run until cancelled. A network that cannot be used is reported once, and tried again."""
        clock = self._feed.clock
        while True:
            try:
                await self._converse()
            except OSError as error:
                self._report(f"{self._config.host}: {error.strerror or 'cannot be reached'}; trying again")
            await clock.sleep_until_ns(clock.monotonic_ns() + AGAIN_NS)

    async def _converse(self) -> None:
        """Until the server has been silent. OSError where name, interface or port cannot be used."""
        clock, session = self._feed.clock, self._session
        address = await _resolve(self._config.host)
        with open_sockets(self._config, address) as (command, *others), self._reading(command, *others):
            self._reported = ""
            session.start(clock.monotonic_ns())
            while True:
                now_ns = clock.monotonic_ns()
                for data in session.due(now_ns):
                    with contextlib.suppress(OSError):  # no route for now; the silence is reported
                        command.sendto(data, (address, self._config.command_port))
                if session.is_silent(now_ns):
                    return
                await clock.sleep_until_ns(now_ns + TURN_NS)

    @contextlib.contextmanager
    def _reading(self, *sockets: socket.socket) -> Iterator[None]:
        loop, buffer = asyncio.get_running_loop(), memoryview(bytearray(LARGEST_PACKET))
        for each in sockets:
            loop.add_reader(each, self._read, each, buffer)
        try:
            yield
        finally:
            for each in sockets:
                loop.remove_reader(each)

    def _read(self, ready: socket.socket, buffer: memoryview) -> None:
        """One packet; where more wait, the loop calls again, everybody else's turn having come first."""
        try:
            size, sender = ready.recvfrom_into(buffer)
        except OSError:  # an ICMP answer to something sent earlier
            return
        self._session.received(bytes(buffer[:size]), sender[0], self._feed.clock.monotonic_ns())

    def _report(self, text: str) -> None:
        if text != self._reported:
            self._reported = text
            self._feed.report(Severity.WARNING, text)


async def _resolve(host: str) -> str:
    try:
        async with asyncio.timeout(RESOLVE_S):
            found = await asyncio.get_running_loop().getaddrinfo(host, None, family=socket.AF_INET)
    except TimeoutError as error:
        raise OSError(0, "its name is not resolved") from error
    return str(found[0][4][0])


@contextlib.contextmanager
def open_sockets(config: NatNetConfig, address: str) -> Iterator[list[socket.socket]]:
    """The command socket, then the one for data. OSError, in words, where one cannot be had."""
    with contextlib.ExitStack() as stack:
        command = stack.enter_context(_udp())
        _bind(command, (config.interface, 0))
        sockets = [command]
        data = stack.enter_context(_udp())
        if config.multicast:
            data.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            _bind(data, (config.multicast, config.data_port))
            _join(data, config, address)
            sockets.append(data)
        else:
            with contextlib.suppress(OSError):  # a server on this machine has it: then it sends to the command socket
                data.bind((config.interface, config.data_port))
                sockets.append(data)
        yield sockets


def _udp() -> socket.socket:
    opened = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    opened.setblocking(False)
    opened.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, BUFFER_BYTES)
    return opened


def _bind(opened: socket.socket, to: tuple[str, int]) -> None:
    try:
        opened.bind(to)
    except OSError as error:
        raise OSError(error.errno, f"{to[0]} port {to[1]}: {error.strerror}") from error


def _join(data: socket.socket, config: NatNetConfig, address: str) -> None:
    """The group on our interface; where none is named, on the one that leads to the server, and on the system's own."""
    interfaces = [config.interface] if config.interface != ANY else [*_toward(address), ANY]
    failed: OSError | None = None
    joined = False
    for interface in dict.fromkeys(interfaces):
        try:
            group = socket.inet_aton(config.multicast) + socket.inet_aton(interface)
            data.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, group)
            joined = True
        except OSError as error:
            failed = OSError(error.errno, f"group {config.multicast} on {interface}: {error.strerror or error}")
    if failed is not None and not joined:
        raise failed


def _toward(address: str) -> list[str]:
    """Our address on the way there."""
    with _udp() as probe, contextlib.suppress(OSError):
        probe.connect((address, 9))
        return [probe.getsockname()[0]]
    return []

"""QTM's server: two ports of one protocol, one a byte order, frames over TCP or UDP, and the answer to a discovery."""

import asyncio
import struct
from typing import Any

from formation.exposure import is_loopback
from formation.messages import RawFrame
from formation.mocap_config import MocapConfig, QualisysConfig
from sim.cameras.servers.qtm import packets
from sim.cameras.servers.qtm.conversation import QtmConversation, Wanted
from sim.cameras.servers.server import Server
from sim.cameras.servers.server_clock import ServerClock
from sim.cameras.servers.tcp import TcpPort
from wire.clock import Clock

DISCOVERY_PORT = 22226
WELCOME = "QTM RT Interface connected"
INFO = "emulator, QTM 2024.3 (build 20041), 8 cameras"


def qtm_server(config: MocapConfig, bodies: tuple[str, ...], clock: Clock) -> Server:
    """Where the lab file's client looks for it."""
    del clock  # exposures carry their time
    qualisys = config.qualisys or QualisysConfig()
    return QtmServer(qualisys.host, qualisys.port, bodies, config.rate_hz)


class QtmServer:
    """On `port` little endian, on the next one big endian, as QTM's base port + 1 and + 2; ports for discovery: one."""

    def __init__(
        self, host: str, port: int, bodies: tuple[str, ...], rate_hz: float, discovery_port: int = DISCOVERY_PORT
    ) -> None:
        self.bodies = bodies
        self.rate_hz = rate_hz
        self._host, self._base_port, self._discovery_port = host, port - 1, discovery_port
        self._time = ServerClock()
        self._number = 0
        self._ports = tuple(self._port(order, port + k) for k, order in enumerate("<>"))
        self._udp: asyncio.DatagramTransport | None = None
        self._discovery: asyncio.DatagramTransport | None = None

    async def start(self) -> None:
        """Listen, frames counted from 1 by a new clock; OSError where an address is taken."""
        self._time, self._number = ServerClock(), 0
        loop = asyncio.get_running_loop()
        try:
            for port in self._ports:
                await port.start()
            self._udp, _ = await loop.create_datagram_endpoint(asyncio.DatagramProtocol, (self._host, 0))
            everywhere = self._host if is_loopback(self._host) else "0.0.0.0"  # where broadcasts come
            self._discovery, _ = await loop.create_datagram_endpoint(
                lambda: Discovery(self._base_port), (everywhere, self._discovery_port), reuse_port=True
            )
        except OSError:
            await self.close()
            raise

    def publish(self, frame: RawFrame) -> None:
        """One exposure to every client that streams; other bodies than before are an event."""
        if frame.bodies != self.bodies:
            self.bodies = frame.bodies
            for port in self._ports:
                port.send(lambda to: packets.packet(to.order, packets.EVENT, bytes([packets.SETTINGS_CHANGED])))
        self._number += 1
        made: dict[tuple[str, tuple[int, ...]], bytes] = {}
        for port in self._ports:
            port.send(lambda to: self._frame_for(to, frame, made))

    async def close(self) -> None:
        """Send the event "QTM shutting down", end every connection and stop listening."""
        for port in self._ports:
            port.send(lambda to: packets.packet(to.order, packets.EVENT, bytes([packets.SHUTTING_DOWN])))
            await port.close()
        for transport in (self._udp, self._discovery):
            if transport is not None:
                transport.close()

    def _port(self, order: str, port: int) -> TcpPort[QtmConversation]:
        hello = packets.text(order, packets.COMMAND, WELCOME)
        return TcpPort(self._host, port, lambda host: (QtmConversation(order, host, self), hello))

    def _frame_for(self, to: QtmConversation, frame: RawFrame, made: dict[tuple[str, tuple[int, ...]], bytes]) -> bytes:
        wanted = to.wanted
        if to.once:
            wanted, to.once = Wanted(to.once), ()
        if wanted is None or self._number % wanted.divisor:
            return b""
        key = to.order, wanted.components
        if key not in made:
            made[key] = self._data(*key, frame)
        if wanted.udp is None:
            return made[key]
        if self._udp is not None:
            self._udp.sendto(made[key], wanted.udp)
        return b""

    def _data(self, order: str, components: tuple[int, ...], frame: RawFrame) -> bytes:
        stamp_us = self._time.at_ns(frame.t_capture_ns) // 1000
        return packets.data_packet(
            order, stamp_us, self._number, [packets.six_d(order, kind, frame) for kind in components]
        )


class Discovery(asyncio.DatagramProtocol):
    """Answers who asks for QTMs with what this one is and its base port, which alone is big endian."""

    def __init__(self, base_port: int) -> None:
        info = INFO.encode() + b"\0"
        self._answer = struct.pack("<II", 10 + len(info), packets.COMMAND) + info + struct.pack(">H", base_port)
        self._transport: Any = None

    def connection_made(self, transport: Any) -> None:
        """Where to answer from."""
        self._transport = transport

    def datagram_received(self, data: bytes, addr: tuple[str, int]) -> None:
        """To the port that the question names."""
        if len(data) == 10 and struct.unpack_from("<II", data) == (10, packets.DISCOVER):
            self._transport.sendto(self._answer, (addr[0], struct.unpack_from(">H", data, 8)[0]))

"""The NatNet server's sockets: commands are answered from one, frames leave the other."""

import asyncio
import contextlib
import socket

from formation.messages import RawFrame
from formation.mocap_config import MocapConfig, NatNetConfig
from sim.cameras.servers.natnet.responder import NatNetSettings, Responder
from wire.clock import Clock

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
    """What a lab file's [mocap.natnet] would be served by; bodies by Motive's names."""
    table = config.natnet or NatNetConfig()
    settings = settings or NatNetSettings(rate_hz=config.rate_hz)
    responder = Responder(settings, table.data_port, table.multicast or None, config.unit_m)
    responder.show(bodies)
    return NatNetServer(table, responder, clock)

"""The emulated VRPN server, spoken to as the VRPN library speaks."""

import asyncio
import struct
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

import numpy as np
import pytest

from formation.mocap_config import MocapConfig
from sim.cameras.servers.vrpn import VrpnServer, vrpn_server
from tests.free_ports import free_port
from wire.clock import REAL_TIME

# Recorded from a vrpn_Tracker_Remote of the VRPN library 07.38.
COOKIE = bytes.fromhex("7672706e3a207665722e2030372e33382020300000000000")
LEADER_IS_1 = bytes.fromhex("00000023 6b02d79b 000b4e46 00000001 ffffffff 00000001 00000007 6c656164657200 0000000000")
PING_IS_16 = bytes.fromhex(
    "00000033 6b02d79b 000b4e47 00000010 fffffffe 00000013"
    "00000017 7672706e5f426173652070696e675f6d65737361676500 0000000000"
)
PINGS_LEADER = bytes.fromhex("00000018 6b02d79d 000e2ad2 00000001 00000010 00000014")
BODIES = ("leader", "left")
POS = np.array([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]])
Q = np.array([[0.8, 0.6, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0]])
LONG_S = 60.0


class Client:
    """Reads messages without our own decoder."""

    def __init__(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self.reader, self.writer = reader, writer

    async def message(self) -> tuple[tuple[int, ...], bytes]:
        async with asyncio.timeout(LONG_S):
            header = struct.unpack(">IIIiiI", await self.reader.readexactly(24))
            body = await self.reader.readexactly((header[0] - 24 + 7) // 8 * 8)
        return header, body[: header[0] - 24]

    async def greet(self) -> tuple[bytes, dict[str, int], dict[str, int]]:
        """Its cookie, senders and types, as far as "vrpn_Base pong_message", which is the last."""
        self.writer.write(COOKIE)
        cookie, names = await self.reader.readexactly(24), {-1: {}, -2: {}}
        while "vrpn_Base pong_message" not in names[-2]:
            (_, _, _, number, kind, _), payload = await self.message()
            (count,) = struct.unpack_from(">i", payload)
            assert count == len(payload) - 4
            assert payload[-1] == 0
            names[kind][payload[4:-1].decode()] = number
        return cookie, names[-1], names[-2]


def config_of(kind: str) -> MocapConfig:
    return MocapConfig.model_validate({"source": kind, kind: {"port": free_port()}})


@asynccontextmanager
async def served(server: VrpnServer) -> AsyncIterator[Client]:
    await server.start()
    client = Client(*await asyncio.open_connection("127.0.0.1", server.port))
    try:
        yield client
    finally:
        client.writer.close()
        await server.close()


def test_the_librarys_ping_is_answered():
    async def steps() -> None:
        server = vrpn_server(config_of("vrpn"), BODIES, REAL_TIME)
        async with served(server) as client:
            _, senders, types = await client.greet()
            client.writer.write(LEADER_IS_1 + PING_IS_16 + PINGS_LEADER)
            header, payload = await client.message()
        assert header[3:5] == (senders["leader"], types["vrpn_Base pong_message"])
        assert payload == b""

    asyncio.run(steps())


def test_a_client_that_asks_by_datagram_is_called_back():
    """As the library's clients do unless told "tcp://": host, blank, port, a null byte."""

    async def steps() -> None:
        server = vrpn_server(config_of("vrpn"), BODIES, REAL_TIME)
        called: asyncio.Future[Client] = asyncio.get_running_loop().create_future()
        listening = await asyncio.start_server(lambda r, w: called.set_result(Client(r, w)), "127.0.0.1", 0)
        port = listening.sockets[0].getsockname()[1]
        async with served(server), listening:
            transport, _ = await asyncio.get_running_loop().create_datagram_endpoint(
                asyncio.DatagramProtocol, remote_addr=("127.0.0.1", server.port)
            )
            for text in (b"", b"nonsense", b"127.0.0.1 22\0", b"127.0.0.1 99999\0", b"a b c\0"):
                transport.sendto(text)
            transport.sendto(f"127.0.0.1 {port}\0".encode())
            client = await asyncio.wait_for(called, LONG_S)
            _, senders, _ = await client.greet()
            transport.close()
            client.writer.close()
        assert "leader" in senders

    asyncio.run(steps())


@pytest.mark.parametrize("data", [b"GET / HTTP/1.1\r\nHost: x\r\n\r\n", COOKIE + b"\xff" * 24])
def test_a_client_that_speaks_something_else_is_dropped(data: bytes):
    async def steps() -> None:
        async with served(vrpn_server(config_of("vrpn"), BODIES, REAL_TIME)) as client:
            client.writer.write(data)
            async with asyncio.timeout(LONG_S):
                try:
                    while await client.reader.read(4096):
                        pass
                except ConnectionError:
                    pass

    asyncio.run(steps())

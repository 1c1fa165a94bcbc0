"""What emulated servers that stream over TCP share: connections, each with a conversation of its own."""

import asyncio
from collections.abc import Callable
from typing import Generic, Protocol, TypeVar

READ_BYTES = 65_536
SEND_BUFFER_MAX_BYTES = 1 << 20
"""A client that reads too slowly misses frames, as it does with the vendors' servers."""


class Conversation(Protocol):
    """One client's, without its socket."""

    def received(self, data: bytes) -> bytes:
        """Take the next bytes; what to answer. ValueError ends the connection."""


C = TypeVar("C", bound=Conversation)


class TcpPort(Generic[C]):
    """A listening port. open: makes a client's conversation of its address, and what is said to it first."""

    def __init__(self, host: str, port: int, open_: Callable[[str], tuple[C, bytes]]) -> None:
        self._host, self._port = host, port
        self._open = open_
        self._server: asyncio.Server | None = None
        self._clients: dict[asyncio.StreamWriter, C] = {}

    async def start(self) -> None:
        """Listen; OSError where the address is taken."""
        self._server = await asyncio.start_server(self._serve, self._host, self._port)

    def conversations(self) -> tuple[C, ...]:
        """Those of the clients that are connected."""
        return tuple(self._clients.values())

    def send(self, message: Callable[[C], bytes]) -> None:
        """To each client what `message` makes of its conversation; nothing to one that is behind."""
        for writer, conversation in list(self._clients.items()):
            if not writer.is_closing() and writer.transport.get_write_buffer_size() < SEND_BUFFER_MAX_BYTES:
                data = message(conversation)
                if data:
                    writer.write(data)

    async def close(self) -> None:
        """Cut every connection and listen no more."""
        if self._server is not None:
            self._server.close()
            for writer in list(self._clients):
                writer.transport.abort()
            await self._server.wait_closed()
            self._server = None

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        try:
            conversation, hello = self._open(writer.get_extra_info("peername")[0])
            self._clients[writer] = conversation
            writer.write(hello)
            while data := await reader.read(READ_BYTES):
                writer.write(conversation.received(data))
        except (OSError, ValueError):
            pass  # the client is gone, or speaks something else
        finally:
            self._clients.pop(writer, None)
            writer.close()

"""The interface of every emulated camera system: frames in, the vendor's protocol out, to any client."""

import asyncio
from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, Protocol, TypeVar

import numpy as np

from formation.maths.arrays import Float
from formation.messages import RawFrame


class Server(Protocol):
    """A vendor's server. It stamps frames by a clock of its own, and shows bodies out of sight as the vendor does."""

    async def start(self) -> None:
        """Listen; OSError where an address is taken."""

    def publish(self, frame: RawFrame) -> None:
        """Send one exposure, metres, to whoever is connected. Its bodies may change from frame to frame.

        Its t_capture_ns is the exposure on our monotonic clock; the server's own clock is that one, moved.
        """

    async def close(self) -> None:
        """End every connection and listen no more."""


PARTS_PER_MILLION = 20e-6


@dataclass(slots=True)
class ServerClock:
    """Moved against ours. rate: its seconds in one of ours."""

    rate: float = 1.0 + PARTS_PER_MILLION
    started_ns: int | None = None

    def at_ns(self, ours_ns: int) -> int:
        """Its time at a time of ours; 1 s when it is asked first, so that nothing lies before its start."""
        if self.started_ns is None:
            self.started_ns = ours_ns
        return 1_000_000_000 + round((ours_ns - self.started_ns) * self.rate)


def matrices(q: Float) -> Float:
    """R_a_from_b of unit q_a_from_b, w x y z; (n, 4) to (n, 3, 3)."""
    w, x, y, z = np.ascontiguousarray(q.T)
    xx, yy, zz = 2.0 * x * x, 2.0 * y * y, 2.0 * z * z
    xy, xz, yz = 2.0 * x * y, 2.0 * x * z, 2.0 * y * z
    wx, wy, wz = 2.0 * w * x, 2.0 * w * y, 2.0 * w * z
    rows = (1.0 - yy - zz, xy - wz, xz + wy, xy + wz, 1.0 - xx - zz, yz - wx, xz - wy, yz + wx, 1.0 - xx - yy)
    return np.stack(rows, axis=-1).reshape(-1, 3, 3)


READ_BYTES = 65_536
SEND_BUFFER_MAX_BYTES = 1 << 20
"""A client that reads too slowly misses frames, as it does with the vendors' servers."""


class Conversation(Protocol):
    """One client's, without its socket."""

    def received(self, data: bytes) -> bytes:
        """Take the next bytes; what to answer. ValueError ends the connection."""


C = TypeVar("C", bound=Conversation)


class TcpPort(Generic[C]):
    """A listening port. open_: makes a client's conversation of its address, and what is said to it first."""

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

"""The client's UDP socket: all that waits is read before any frame is given up, since its poses may be among them."""

import asyncio
import socket
from collections.abc import Callable

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

"""The UDP sockets of one port: one that only the expected peer reaches, and one for whoever else sends there.

The kernel gives a datagram to the socket that is connected to its sender, where there is one. So the peer has a buffer
of its own, and whatever strangers send at any rate overflows theirs.
"""

import socket
from typing import NamedTuple

SocketAddress = tuple[str, int]
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

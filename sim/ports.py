"""Network ports of this machine that one flight has for itself, so that several can fly side by side."""

import socket
from collections.abc import Iterable, Iterator
from contextlib import contextmanager

from formation.config import LinkConfig

LOOPBACK = "127.0.0.1"
BLOCK = 300
"""Ports from one block's beginning to the next: more than sysids, and the drones' base lies 40 above the ground's."""
BLOCKS = 60
"""All below 32768, from where on the kernel hands out ports by itself."""


@contextmanager
def private_link(kind: str, sysids: Iterable[int]) -> Iterator[LinkConfig]:
    """A link configuration on this machine alone, nobody else's in the block; the usual UDP ports where they are free.

    OSError if no block is free.
    """
    usual = LinkConfig()
    drone_offset = usual.drone_port_base - usual.ground_port_base
    drones = [offset + sysid for sysid in sysids for offset in (0, drone_offset)]
    with own_ports(drones) as ports:
        yield LinkConfig.model_validate(
            {
                "kind": kind,
                "ground_port_base": ports.start,
                "drone_port_base": ports.start + drone_offset,
                "zenoh_connect": (f"tcp/{LOOPBACK}:{ports.start}",),
            }
        )


@contextmanager
def own_ports(needed: Iterable[int] = ()) -> Iterator[range]:
    """A block of ports that nobody else who asks here is given meanwhile. OSError if none is free.

    A block's last UDP port, which is no drone's, is held as its sign; its first port, by TCP for the bus and by UDP for
    a stop, and the UDP ports `needed`, counted from the first, are free.
    """
    first, wanted = LinkConfig().ground_port_base, (0, *needed)
    for start in range(first, first + BLOCKS * BLOCK, BLOCK):
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sign:
            try:
                sign.bind((LOOPBACK, start + BLOCK - 1))
            except OSError:
                continue
            if is_free(start, socket.SOCK_STREAM) and all(is_free(start + port) for port in wanted):
                yield range(start, start + BLOCK)
                return
    raise OSError(f"none of {BLOCKS} blocks of ports from {first} on is free")


def is_free(port: int, kind: socket.SocketKind = socket.SOCK_DGRAM) -> bool:
    """Whether nobody has that port of loopback at the moment."""
    with socket.socket(socket.AF_INET, kind) as probe:
        if kind is socket.SOCK_STREAM:  # as a server does: what an ended connection has left is in nobody's way
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((LOOPBACK, port))
        except OSError:
            return False
        return True

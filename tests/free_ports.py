"""Ports for tests that run side by side: each test process has a block of its own for as long as it lives."""

import socket
from collections.abc import Iterator
from functools import cache
from itertools import cycle

from sim.ports import is_free, own_ports


def free_port(count: int = 1) -> int:
    """The first of `count` ports in a row that nobody has, neither over UDP nor over TCP; another at every call."""
    while True:
        row = [next(_own()) for _ in range(count)]
        if row[-1] - row[0] == count - 1 and all(is_free(port, kind) for port in row for kind in KINDS):
            return row[0]


KINDS = (socket.SOCK_DGRAM, socket.SOCK_STREAM)


@cache
def _own() -> Iterator[int]:
    return _held()


def _held() -> Iterator[int]:
    with own_ports() as ports:
        yield from cycle(ports[1:])

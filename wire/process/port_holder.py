"""Which program has a port, as far as this machine says (Linux's /proc): for the line on why a port cannot be had."""

import errno
from collections.abc import Iterable, Iterator
from contextlib import suppress
from pathlib import Path

from formation.exposure import is_local_endpoint
from wire.security.bus_access import connectable
from wire.text import plain

_PROC = Path("/proc")
_LISTENS, _BOUND = "0A", "07"  # net/tcp_states.h, as /proc/net/tcp and /proc/net/udp have them


def why_not_bound(error: OSError, kind: str, port: int) -> str:
    """Why the port could not be bound, with the program that has it; kind: "udp" or "tcp"."""
    holder = port_holder(kind, port) if error.errno == errno.EADDRINUSE else ""
    return f"{error.strerror or error}{f': {holder} has it' if holder else ''}"


def port_holder(kind: str, port: int) -> str:
    """The program that has the port, `command line (process 123)`; empty where nobody has it.

    Another user's program is not named. kind: "udp", or "tcp" for who listens there.
    """
    sockets = {f"socket:[{number}]" for number in _sockets(kind, port)}
    if not sockets:
        return ""
    for link in _PROC.glob("[0-9]*/fd/*"):
        with suppress(OSError):  # it has ended, or is another user's
            if str(link.readlink()) in sockets:
                process = link.parts[2]
                words = (_PROC / process / "cmdline").read_bytes().replace(b"\0", b" ").decode(errors="replace")
                return f"{plain(words.strip(), 60)} (process {process})"
    return "another program"


def listener(endpoints: Iterable[str]) -> str:
    """The program of this machine that listens at one of these endpoints of the bus; empty where none does."""
    ports = (endpoint.rpartition(":")[2] for endpoint in endpoints if is_local_endpoint(connectable(endpoint)))
    return next(filter(None, (port_holder("tcp", int(port)) for port in ports if port.isdigit())), "")


def _sockets(kind: str, port: int) -> Iterator[str]:
    """The numbers (inodes) of the sockets of that port."""
    for table in (kind, f"{kind}6"):
        with suppress(OSError):  # no Linux, or no IPv6
            for line in (_PROC / "net" / table).read_text().splitlines()[1:]:
                fields = line.split()
                bound = fields[3] == (_LISTENS if kind == "tcp" else _BOUND)
                if bound and int(fields[1].rpartition(":")[2], 16) == port:
                    yield fields[9]

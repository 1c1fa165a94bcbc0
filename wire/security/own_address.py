"""Which of this machine's addresses leads to another machine, and ports for this machine alone."""

import socket
from ipaddress import ip_address

_ANY_PORT = 9  # of "discard"; nothing is sent


def address_towards(host: str) -> str:
    """This machine's address on the way to a host, by its routes; `host` itself where it is any address. OSError."""
    try:
        if ip_address(host).is_unspecified:
            return host
    except ValueError:
        pass  # a name
    (family, kind, _, _, where), *_ = socket.getaddrinfo(host, _ANY_PORT, type=socket.SOCK_DGRAM)
    with socket.socket(family, kind) as probe:
        probe.connect(where)
        return str(probe.getsockname()[0])


def free_loopback_port() -> int:
    """A TCP port of loopback that nobody has now."""
    with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])

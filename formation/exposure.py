"""Who is on a lab's links: names of those with keys, and which endpoints other machines reach. Pure, without arrays.

Addresses are parsed as addresses, never matched as text.
"""

from ipaddress import ip_address
from re import fullmatch

GROUND, MOCAP, PAGE, TOOL = "ground", "mocap", "page", "tool"
OWN_IDENTITIES = (GROUND, MOCAP, PAGE, TOOL)
"""The identities that every lab has, beside one for each drone."""


def drone_identity(sysid: int) -> str:
    """The identity of a drone's host."""
    return f"drone-{sysid}"


def numbered(identity: str, number: int) -> str:
    """The name in an identity's certificate: each new certificate has the next number, and the old one is void."""
    return f"{identity}.{number}"


def identity_in(certificate_name: str) -> str:
    """The identity that a name in a certificate belongs to."""
    return certificate_name.rpartition(".")[0]


_LOCAL_PROTOCOLS = ("unixsock-stream", "unixpipe")
_ADDRESS = r"(\[[^\[\]\s]+\]|[^:/\s]+):\d{1,5}([?#]\S*)?"


def is_loopback(host: str) -> bool:
    """Whether only this machine reaches the host: a loopback address, or `localhost` by exactly that name.

    Every other name counts as another machine's, since what it leads to is decided elsewhere.
    """
    try:
        return ip_address(host).is_loopback
    except ValueError:
        return host.lower() == "localhost"


def is_local_endpoint(endpoint: str) -> bool:
    """Whether only this machine reaches an endpoint of the bus, `protocol/address`; False for what is none."""
    return endpoint.partition("/")[0] in _LOCAL_PROTOCOLS or is_loopback(endpoint_host(endpoint))


def endpoint_host(endpoint: str) -> str:
    """The host of an endpoint of the bus, an IPv6 address without its brackets; empty where it has none."""
    found = fullmatch(_ADDRESS, endpoint.partition("/")[2])
    return "" if found is None else found[1].removeprefix("[").removesuffix("]")


def is_local_link(link: str) -> bool:
    """Whether only this machine reaches a drone's own link, `udp:HOST:PORT`, or hands bytes to a serial line."""
    kind, _, where = link.partition(":")
    return kind == "serial" or is_loopback(where.rpartition(":")[0])

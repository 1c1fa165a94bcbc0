"""How a process may be on the lab's bus: with the keys of an identity, or on this machine alone.

With keys every link is TLS, both ends show certificates of the lab's authority, and every process enforces who may do
what by the names in them (`access.json`). Zenoh does all of it; here is what it is configured with.
"""

import socket
from collections.abc import Sequence
from dataclasses import dataclass
from ipaddress import ip_address
from pathlib import Path
from re import sub

from formation.exposure import endpoint_host, is_local_endpoint
from wire.errors import BusError, ConfigError
from wire.files import read_text
from wire.security.private_keys import (
    AUTHORITY,
    CERTIFICATE,
    HUB,
    NAME,
    PRIVATE,
    demand_private,
    demand_private_tree,
    read_access,
    read_name,
    write_private,
)


def address_towards(host: str) -> str:
    """This machine's address on the way to a host, by its routes; `host` itself where it is any address. OSError."""
    try:
        if ip_address(host).is_unspecified:
            return host
    except ValueError:
        pass  # a name
    discard = 9  # any port: nothing is sent
    (family, kind, _, _, where), *_ = socket.getaddrinfo(host, discard, type=socket.SOCK_DGRAM)
    with socket.socket(family, kind) as probe:
        probe.connect(where)
        return str(probe.getsockname()[0])


def free_loopback_port(kind: socket.SocketKind = socket.SOCK_STREAM) -> int:
    """A port of loopback that nobody has now, of TCP or, with SOCK_DGRAM, of UDP."""
    with socket.socket(socket.AF_INET, kind) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


REMEDY = "run `gcs keys new lab.toml` and write [security] into the lab file, or, for simulation only, --insecure"
MESSAGE_MOST = 1 << 19
"""Bytes of one message that a process with keys receives: twice the largest payload that anything here reads."""
_PROTOCOLS = ("tcp", "tls")


class ExposedError(BusError):
    """An endpoint that other machines reach, without keys; the text has the endpoint and the command to run."""

    def __init__(self, what: str, endpoint: str) -> None:
        super().__init__(f"{what} {endpoint} is not on this machine, and nothing authenticates it: {REMEDY}")


@dataclass(frozen=True, slots=True)
class BusAccess:
    """The folder of the identity's keys, None for none; insecure: open to other machines all the same."""

    identity: Path | None = None
    insecure: bool = False

    @property
    def name(self) -> str:
        """The name in the identity's certificate; empty without keys. ConfigError."""
        return "" if self.identity is None else read_name(self.identity / NAME)

    def demand(self, endpoints: Sequence[str]) -> None:
        """ExposedError for an endpoint that is not this machine's, without keys; BusError for one that has no TLS."""
        for endpoint in endpoints:
            if self.identity is not None and endpoint.partition("/")[0] not in _PROTOCOLS:
                raise BusError(f"{endpoint}: with keys the bus is TLS alone: write tls/HOST:PORT")
        exposed = self.exposed(endpoints)
        if exposed is not None:
            raise exposed

    def exposed(self, endpoints: Sequence[str]) -> ExposedError | None:
        """The fault of the first endpoint that is not this machine's, without keys; None where there is none."""
        if self.identity is not None or self.insecure:
            return None
        far = [endpoint for endpoint in endpoints if not is_local_endpoint(endpoint)]
        return ExposedError("the bus at", far[0]) if far else None

    def carried(self, endpoints: Sequence[str]) -> list[str]:
        """The endpoints as they are opened: TLS with keys, as they are without."""
        return (
            [sub("^tcp/", "tls/", endpoint) for endpoint in endpoints] if self.identity is not None else list(endpoints)
        )

    def own_endpoint(self, connect: Sequence[str]) -> str:
        """Where a process listens that is not the hub: on loopback, or at this machine's address towards another hub.

        Raises OSError where no route leads there.
        """
        far = [endpoint for endpoint in connect if not is_local_endpoint(endpoint)]
        host = address_towards(endpoint_host(far[0])) if far else "127.0.0.1"
        host = f"[{host}]" if ":" in host else host
        return f"{'tcp' if self.identity is None else 'tls'}/{host}:0"

    def open_loopback(self, listen: Sequence[str]) -> list[str]:
        """Where a hub with keys listens beside the lab's endpoints: for this machine's own processes.

        Zenoh (1.10) accepts nobody for 0.1 s after each connection that is no TLS: a stranger, or a page that the
        browser of this machine shows, keeps everybody out of an endpoint that it knows. This one stands in the folder
        of keys alone. OSError.
        """
        if self.identity is None or not listen:
            return []
        endpoint = f"tls/127.0.0.1:{free_loopback_port()}"
        write_private(self.identity.parent / HUB, endpoint.encode())
        return [endpoint]

    def loopback(self) -> list[str]:
        """Where the hub of this machine listens for it alone; none where there is none, and without keys."""
        if self.identity is None:
            return []
        try:
            endpoint = read_text(self.identity.parent / HUB)
        except (OSError, ValueError):
            return []
        return [endpoint] if is_local_endpoint(endpoint) else []

    def configuration(self) -> dict[str, object]:
        """Zenoh's settings of TLS and access control; none without keys. ConfigError."""
        if self.identity is None:
            return {}
        own = self.identity
        return {
            "transport/link/protocols": ["tls"],
            "transport/link/tls/root_ca_certificate": str(own / AUTHORITY),
            "transport/link/tls/listen_certificate": str(own / CERTIFICATE),
            "transport/link/tls/listen_private_key": str(own / PRIVATE),
            "transport/link/tls/connect_certificate": str(own / CERTIFICATE),
            "transport/link/tls/connect_private_key": str(own / PRIVATE),
            "transport/link/tls/enable_mtls": True,
            "transport/link/tls/verify_name_on_connect": True,
            "transport/link/tls/close_link_on_expiration": True,
            "transport/link/rx/max_message_size": MESSAGE_MOST,
            "access_control": read_access(own),
        }


LOCAL = BusAccess()


def access_with(keys: Path, identity: str) -> BusAccess:
    """The access of an identity in a folder of keys. ConfigError for keys that are missing or open to others."""
    demand_private(keys)
    demand_private_tree(keys / identity)
    return BusAccess(keys / identity)


def own_access(keys: Path, identity: str = "") -> BusAccess:
    """The access of a person's command: that identity, else `tool`, else the folder's only one. ConfigError."""
    if not identity:
        demand_private(keys)
        there = sorted(path.name for path in keys.iterdir() if (path / CERTIFICATE).is_file())
        identity = "tool" if "tool" in there else there[0] if len(there) == 1 else ""
        if not identity:
            raise ConfigError([f"{keys}: no identity `tool`; --identity says which of {', '.join(there) or 'none'}"])
    return access_with(keys, identity)


def connectable(endpoint: str) -> str:
    """The endpoint for a process of this machine: where the file says any address, loopback."""
    host = endpoint_host(endpoint)
    try:
        anywhere = ip_address(host)
    except ValueError:
        return endpoint
    if not anywhere.is_unspecified:
        return endpoint
    return endpoint.replace(host, "127.0.0.1", 1) if anywhere.version == 4 else endpoint.replace(host, "::1", 1)

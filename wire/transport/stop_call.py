"""A stop by one datagram, as who asks sends it: again and again until its answer comes, or for long enough."""

import select
import socket
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from ipaddress import ip_address

from formation.exposure import endpoint_host
from formation.requests import OperatorReply, OperatorRequest
from wire import clock
from wire.security.bus_access import BusAccess, connectable
from wire.security.private_keys import STOP_KEY, read_mavlink_key
from wire.security.stop_datagram import LARGEST, decode_reply, encode_stop

AGAIN_S = 0.01


def stop_by_datagram(
    endpoints: Sequence[str], access: BusAccess, request: OperatorRequest, wait_s: float
) -> OperatorReply | None:
    """The ground's answer; None where none came, nobody listens, or this identity has no key for it. ConfigError."""
    path = None if access.identity is None else access.identity / STOP_KEY
    if path is None or not path.exists():
        return None
    key = read_mavlink_key(path)
    data = encode_stop(access.name, key, request.id, request.source)
    until_ns = clock.monotonic_ns() + round(wait_s * 1e9)
    with ExitStack() as opened:
        grounds = [opened.enter_context(each) for endpoint in endpoints for each in _connected(endpoint)]
        while grounds and clock.monotonic_ns() < until_ns:
            grounds = [each for each in grounds if _sent(each, data)]
            for each in select.select(grounds, (), (), AGAIN_S)[0]:
                try:
                    reply = decode_reply(each.recv(LARGEST), key, request.id)
                except ConnectionRefusedError:  # its machine says that nobody listens there
                    grounds.remove(each)
                except OSError:
                    continue
                else:
                    if reply is not None:
                        return reply
    return None


def _sent(ground: socket.socket, data: bytes) -> bool:
    """Whether somebody may listen there: a machine that refuses says that nobody does."""
    try:
        ground.send(data)
    except ConnectionRefusedError:
        return False
    except OSError:  # no room, or no route for the moment
        return True
    return True


def stop_address(endpoint: str) -> tuple[str, int] | None:
    """Where the datagrams of an endpoint go: UDP, the same port. None without an address: no name is looked up."""
    host, port = endpoint_host(endpoint), endpoint.rpartition(":")[2]
    try:
        return str(ip_address(host)), int(port)
    except ValueError:
        return None


def _connected(endpoint: str) -> Iterator[socket.socket]:
    address = stop_address(connectable(endpoint))
    if address is None:
        return
    made = socket.socket(socket.AF_INET6 if ":" in address[0] else socket.AF_INET, socket.SOCK_DGRAM)
    try:
        made.setblocking(False)
        made.connect(address)
    except OSError:  # no route leads there
        made.close()
    else:
        yield made

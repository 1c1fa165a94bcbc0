"""A stop as who asks sends it, in two ways at once: by datagrams, again and again, and over the bus."""

import select
import socket
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from queue import Empty, SimpleQueue
from threading import Thread

from formation.exposure import endpoint_host
from formation.requests import GCS_NAME, OperatorReply, OperatorRequest
from wire import clock
from wire.errors import BusError, ConfigError
from wire.process.leaving import CLOSING
from wire.security.bus_access import BusAccess, connectable
from wire.security.private_keys import STOP_KEY, read_mavlink_key
from wire.security.stop_datagram import LARGEST, NO_CHALLENGE, decode_reply, encode_stop

ANSWER_S = 3.0
"""How long an answer is awaited where no other time is given."""
AGAIN_S = 0.01
HEAD_START_S = 0.1
"""Of the datagrams: a busy computer takes longer to load the bus than a ground to answer."""


def ask_to_stop(
    endpoints: Sequence[str], lab: str, name: str, request: OperatorRequest, wait_s: float | None, access: BusAccess
) -> OperatorReply:
    """The ground's answer, by datagram or over the bus, whichever comes first; both go on until then.

    Raises as `wire.transport.zenoh_session.ask`. wait_s: None for ANSWER_S where there is anybody on the bus.
    """
    outcomes: SimpleQueue[OperatorReply | Exception | None] = SimpleQueue()
    datagrams_s = (ANSWER_S if wait_s is None else wait_s) if name == GCS_NAME else 0.0

    def by_datagram() -> OperatorReply | None:
        return stop_by_datagram(endpoints, lab, access, request, datagrams_s)

    def by_bus() -> OperatorReply:
        from wire.transport.zenoh_session import Patience, ask

        # Without a time given it is tried for as long as there is anybody on the bus.
        patience = Patience(ANSWER_S, ground_s=ANSWER_S) if wait_s is None else Patience.throughout(wait_s)
        return ask(endpoints, lab, name, request, patience, access)

    def run(asked: Callable[[], OperatorReply | None]) -> None:
        outcome: OperatorReply | Exception | None = None
        try:
            outcome = asked()
        except (TimeoutError, BusError, ConfigError) as error:
            outcome = error
        finally:
            outcomes.put(outcome)

    failure: Exception = TimeoutError("neither by datagram nor over the bus")
    routes, unanswered = [by_datagram, by_bus], 0
    while routes or unanswered:
        if routes:
            Thread(target=run, args=(routes.pop(0),), name=CLOSING, daemon=True).start()
            unanswered += 1
        try:
            outcome = outcomes.get(timeout=HEAD_START_S if routes else None)
        except Empty:
            continue
        unanswered -= 1
        if isinstance(outcome, OperatorReply):
            return outcome
        failure = outcome or failure
    raise failure


def stop_by_datagram(
    endpoints: Sequence[str], lab: str, access: BusAccess, request: OperatorRequest, wait_s: float
) -> OperatorReply | None:
    """The ground's answer; None where none came, nobody listens, or this identity has no key for it. ConfigError."""
    key = lab.encode()
    if access.identity is not None:
        if not (access.identity / STOP_KEY).exists():
            return None
        key = read_mavlink_key(access.identity / STOP_KEY)

    def sealed(challenge: bytes) -> bytes:
        return encode_stop(access.name, key, request.id, request.source, challenge)

    until_ns = clock.monotonic_ns() + round(wait_s * 1e9)
    with ExitStack() as opened:
        sockets = [opened.enter_context(each) for endpoint in endpoints for each in _connected(endpoint)]
        grounds = dict.fromkeys(sockets, sealed(NO_CHALLENGE))
        while grounds and clock.monotonic_ns() < until_ns:
            grounds = {each: data for each, data in grounds.items() if _sent(each, data)}
            for each in select.select(grounds, (), (), AGAIN_S)[0]:
                try:
                    reply = decode_reply(each.recv(LARGEST), key, request.id)
                except ConnectionRefusedError:  # its machine says that nobody listens there
                    del grounds[each]
                except OSError:
                    continue
                else:
                    if isinstance(reply, OperatorReply):
                        return reply
                    if reply is not None:
                        grounds[each] = sealed(reply)
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


def stop_address(endpoint: str) -> tuple[socket.AddressFamily, tuple[str, int]] | None:
    """Where the datagrams of an endpoint go: UDP, the same port. None for one without a host; OSError, by its name."""
    host, port = endpoint_host(endpoint), endpoint.rpartition(":")[2]
    if not host or not port.isdigit():
        return None
    family, _, _, _, address = socket.getaddrinfo(host, int(port), type=socket.SOCK_DGRAM)[0]
    return family, (str(address[0]), int(address[1]))


def _connected(endpoint: str) -> Iterator[socket.socket]:
    try:
        found = stop_address(connectable(endpoint))
        if found is None:
            return
        made = socket.socket(found[0], socket.SOCK_DGRAM)
    except OSError:  # nobody knows the name
        return
    try:
        made.setblocking(False)
        made.connect(found[1])
    except OSError:  # no route leads there
        made.close()
    else:
        yield made

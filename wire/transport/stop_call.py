"""A stop: its datagram and its answer, authenticated and never obeyed twice; and as who asks sends it, in two ways.

The bus lets nobody in while a stranger keeps its listener busy; a datagram needs no connection. Who asks sends
datagrams, again and again, and asks over the bus besides. All are authenticated by HMAC-SHA256 with a key of who asks,
which the ground has, too; in a lab without keys by the lab's name:

    request    "FSTOP1" name 0 id challenge source mac
    challenge  "FSTOP3" id challenge mac                      reply  "FSTOP2" id accepted text mac

The ground (`stop_port`) obeys what repeats its challenge, which it draws anew with every stop: a recorded request is
worth nothing, to a restarted ground neither, and no clock has to be right. Who asks learns the challenge by asking.
"""

import hmac
import select
import socket
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from queue import Empty, SimpleQueue
from threading import Thread

from formation.exposure import endpoint_host
from formation.requests import ANSWER_S, GCS_NAME, OperatorReply, OperatorRequest
from wire import clock
from wire.errors import BusError, ConfigError
from wire.process.system import CLOSING
from wire.security.bus_access import BusAccess, connectable
from wire.security.private_keys import STOP_KEY, read_mavlink_key

REQUEST, REPLY, CHALLENGE = b"FSTOP1", b"FSTOP2", b"FSTOP3"
LARGEST = 1024
SOURCE_MOST, TEXT_MOST = 100, 400
_MAC, _ID, _DRAWN = 32, 8, 16
NO_CHALLENGE = bytes(_DRAWN)
"""The challenge in a first request: none was given yet."""

NO_STOP = "datagram that is no stop"
UNKNOWN = "stop of a name that is not known"
WRONG = "stop that its key has not sealed"


@dataclass(frozen=True, slots=True)
class StopRequest:
    """A request that its asker's key has sealed; again: the one before, whose answer may have been lost."""

    name: str
    id: int
    source: str
    again: bool


@dataclass(slots=True)
class StopReader:
    """The ground's end. key_of: the key of a name in a certificate, None where there is none; draw: random bytes."""

    key_of: Callable[[str], bytes | None]
    draw: Callable[[int], bytes]
    _challenges: dict[str, bytes] = field(default_factory=dict)
    _obeyed: dict[str, tuple[int, bytes]] = field(default_factory=dict)
    """Id and challenge of the newest stop, by name."""

    def read(self, data: bytes) -> StopRequest | bytes | str:
        """The request, or the challenge to answer it with, or why it is rejected."""
        name_end = data.find(b"\0", 0, 100)
        at = name_end + 1
        if len(data) > LARGEST or not data.startswith(REQUEST) or name_end < 0 or len(data) < at + _ID + _DRAWN + _MAC:
            return NO_STOP
        name = data[len(REQUEST) : name_end].decode("ascii", "replace")
        key = self.key_of(name)
        if key is None:
            return UNKNOWN
        if not hmac.compare_digest(_mac(key, data[:-_MAC]), data[-_MAC:]):
            return WRONG
        asked = (int.from_bytes(data[at : at + _ID], "big"), data[at + _ID : at + _ID + _DRAWN])
        again = asked == self._obeyed.get(name)
        if not again:
            if asked[1] != self._challenges.setdefault(name, self.draw(_DRAWN)):
                body = CHALLENGE + data[at : at + _ID] + self._challenges[name]
                return body + _mac(key, body)
            self._obeyed[name], self._challenges[name] = asked, self.draw(_DRAWN)
        return StopRequest(name, asked[0], data[at + _ID + _DRAWN : -_MAC].decode("utf-8", "replace"), again)

    def reply(self, asked: StopRequest, reply: OperatorReply) -> bytes:
        """The answer to a request."""
        head = REPLY + asked.id.to_bytes(_ID, "big") + bytes((reply.accepted,))
        body = head + reply.text.encode()[:TEXT_MOST]
        return body + _mac(self.key_of(asked.name) or b"", body)


def encode_stop(name: str, key: bytes, request_id: int, source: str, challenge: bytes = NO_CHALLENGE) -> bytes:
    """A request; in a lab without keys its name is empty and the key the lab's name: no other lab's ground obeys."""
    head = REQUEST + name.encode("ascii") + b"\0" + request_id.to_bytes(_ID, "big") + challenge
    body = head + source.encode()[:SOURCE_MOST]
    return body + _mac(key, body)


def decode_reply(data: bytes, key: bytes, request_id: int) -> OperatorReply | bytes | None:
    """The ground's answer to the request, or its challenge; None for anything else."""
    if len(data) < len(REPLY) + _ID + 1 + _MAC or not hmac.compare_digest(_mac(key, data[:-_MAC]), data[-_MAC:]):
        return None
    head, body = data[: len(REPLY) + _ID], data[len(REPLY) + _ID : -_MAC]
    if head == CHALLENGE + request_id.to_bytes(_ID, "big") and len(body) == _DRAWN:
        return body
    if head != REPLY + request_id.to_bytes(_ID, "big"):
        return None
    return OperatorReply(request_id, body[0] == 1, body[1:].decode("utf-8", "replace"))


def _mac(key: bytes, data: bytes) -> bytes:
    return hmac.digest(key, data, "sha256")


AGAIN_S = 0.01
HEAD_START_S = 0.1
"""Delay of the datagrams: a busy computer takes longer to load the bus than a ground to answer."""


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

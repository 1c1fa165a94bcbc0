"""A stop by datagrams, and its answer: authenticated, never obeyed twice, read in a few microseconds. Pure.

The bus lets nobody in while a stranger keeps its listener busy; a datagram needs no connection. All are authenticated
by HMAC-SHA256 with a key of who asks, which the ground has, too; in a lab without keys by the lab's name:

    request    "FSTOP1" name 0 id challenge source mac
    challenge  "FSTOP3" id challenge mac                      reply  "FSTOP2" id accepted text mac

The ground obeys what repeats its challenge, which it draws anew with every stop: a recorded request is worth nothing,
to a restarted ground neither, and no clock has to be right. Who asks learns the challenge by asking.
"""

import hmac
from collections.abc import Callable
from dataclasses import dataclass, field

from formation.requests import OperatorReply

REQUEST, REPLY, CHALLENGE = b"FSTOP1", b"FSTOP2", b"FSTOP3"
LARGEST = 1024
SOURCE_MOST, TEXT_MOST = 100, 400
_MAC, _ID, _DRAWN = 32, 8, 16
NO_CHALLENGE = bytes(_DRAWN)
"""Of a first request."""

NO_STOP = "datagram that is no stop"
UNKNOWN = "stop of a name that is not known"
WRONG = "stop that its key has not sealed"


@dataclass(frozen=True, slots=True)
class StopAsked:
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

    def read(self, data: bytes) -> StopAsked | bytes | str:
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
        return StopAsked(name, asked[0], data[at + _ID + _DRAWN : -_MAC].decode("utf-8", "replace"), again)

    def reply(self, asked: StopAsked, reply: OperatorReply) -> bytes:
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

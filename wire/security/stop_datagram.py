"""A stop in one datagram, and its answer: authenticated, never obeyed twice, read in a few microseconds. Pure.

The bus lets nobody in while a stranger keeps its listener busy; a datagram needs no connection. Both are authenticated
by HMAC-SHA256 with a key of who asks, which the ground has, too:

    request  "FSTOP1" name 0 id source mac        reply  "FSTOP2" id accepted text mac

The id is the asker's clock, us since 1970: a request is rejected that is not later than the one before.
"""

import hmac
from collections.abc import Callable
from dataclasses import dataclass, field

from formation.requests import OperatorReply

REQUEST, REPLY = b"FSTOP1", b"FSTOP2"
LARGEST = 1024
SOURCE_MOST, TEXT_MOST = 100, 400
WINDOW_US = 60_000_000
"""How far the clocks of two computers may be apart."""
_MAC, _ID = 32, 8

NO_STOP = "datagram that is no stop"
UNKNOWN = "stop of a name that is not known"
WRONG = "stop that its key has not sealed"
OLD = "stop that came before, or from another time"


@dataclass(frozen=True, slots=True)
class StopAsked:
    """A request that its asker's key has sealed; again: the one before, whose answer may have been lost."""

    name: str
    id: int
    source: str
    again: bool


@dataclass(slots=True)
class StopReader:
    """The ground's end. key_of: the key of a name in a certificate, None where there is none."""

    key_of: Callable[[str], bytes | None]
    begun_us: int
    """When the ground began, us since 1970: what was sent before may have been obeyed before."""
    _newest: dict[str, int] = field(default_factory=dict)

    def read(self, data: bytes, now_us: int) -> StopAsked | str:
        """The request, or why it is rejected."""
        name_end = data.find(b"\0", 0, 100)
        if len(data) > LARGEST or not data.startswith(REQUEST) or name_end < 0 or len(data) < name_end + 1 + _ID + _MAC:
            return NO_STOP
        name = data[len(REQUEST) : name_end].decode("ascii", "replace")
        key = self.key_of(name)
        if key is None:
            return UNKNOWN
        if not hmac.compare_digest(_mac(key, data[:-_MAC]), data[-_MAC:]):
            return WRONG
        at = name_end + 1
        asked_us = int.from_bytes(data[at : at + _ID], "big")
        newest = self._newest.get(name, self.begun_us)
        if asked_us < newest or abs(asked_us - now_us) > WINDOW_US:
            return OLD
        self._newest[name] = asked_us
        source = data[at + _ID : -_MAC].decode("utf-8", "replace")
        return StopAsked(name, asked_us, source, again=asked_us == newest)

    def reply(self, asked: StopAsked, reply: OperatorReply) -> bytes:
        """The answer to a request."""
        head = REPLY + asked.id.to_bytes(_ID, "big") + bytes((reply.accepted,))
        body = head + reply.text.encode()[:TEXT_MOST]
        return body + _mac(self.key_of(asked.name) or b"", body)


def encode_stop(name: str, key: bytes, asked_us: int, source: str) -> bytes:
    """A request, at the time that the asker's clock shows."""
    head = REQUEST + name.encode("ascii") + b"\0" + asked_us.to_bytes(_ID, "big")
    body = head + source.encode()[:SOURCE_MOST]
    return body + _mac(key, body)


def decode_reply(data: bytes, key: bytes, asked_us: int) -> OperatorReply | None:
    """The ground's answer to the request of that time; None for anything else."""
    head = REPLY + asked_us.to_bytes(_ID, "big")
    if not data.startswith(head) or len(data) < len(head) + 1 + _MAC:
        return None
    if not hmac.compare_digest(_mac(key, data[:-_MAC]), data[-_MAC:]):
        return None
    return OperatorReply(asked_us, data[len(head)] == 1, data[len(head) + 1 : -_MAC].decode("utf-8", "replace"))


def _mac(key: bytes, data: bytes) -> bytes:
    return hmac.digest(key, data, "sha256")

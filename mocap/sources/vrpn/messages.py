"""VRPN's wire format, for both ends: cookie, message header, descriptions of senders and types, tracker poses.

Source: Format_Of_Protocol.txt of the VRPN library, and where that is wrong, what the library does. All is big-endian;
header and payload each end on 8 bytes. The length in a header counts header and payload, not the payload's padding.
"""

from collections.abc import Iterator
from struct import Struct, error
from typing import NamedTuple

from mocap.sources.tcp import ProtocolError

COOKIE_BYTES = 24
COOKIE = b"vrpn: ver. 07.35  0".ljust(COOKIE_BYTES, b"\0")
_COOKIE_START, _MAJOR = b"vrpn: ver. ", b"07."
"""The minor version, after the dot, is of no consequence: the VRPN library, too, reads every 07."""

SENDER_DESCRIPTION, TYPE_DESCRIPTION, UDP_DESCRIPTION = -1, -2, -3
POSE_TYPE = b"vrpn_Tracker Pos_Quat"
PING_TYPE, PONG_TYPE = b"vrpn_Base ping_message", b"vrpn_Base pong_message"
CONTROL = b"VRPN Control"
"""A sender of every server: the connection itself, which answers no ping."""

HEADER = Struct(">IIIiiI")
"""Length, seconds, microseconds, sender, type, sequence number (of each channel, for sniffers)."""
LONGEST_PAYLOAD = 64_000
MOST_IDS = 2000
LONGEST_NAME = 100
POSE = Struct(">ii7d")
"""Sensor, padding; x y z; quaternion x y z w."""
POSE_BYTES = POSE.size
_COUNT = Struct(">i")


class Message(NamedTuple):
    """One message: the server's clock at its stamp in ns, whom it is of, what it is, and what it says."""

    stamp_ns: int
    sender: int
    type: int
    payload: bytes


def check_cookie(data: bytes) -> None:
    """ProtocolError where `data` (24 bytes) is no VRPN of a version that can be read."""
    if not data.startswith(_COOKIE_START):
        raise ProtocolError("the cookie is not VRPN's")
    if not data.startswith(_MAJOR, len(_COOKIE_START)):
        raise ProtocolError("the cookie's version is not 07")


def message(stamp_ns: int, sender: int, kind: int, payload: bytes = b"") -> bytes:
    """One message as it is sent."""
    seconds, ns = divmod(stamp_ns, 1_000_000_000)
    header = HEADER.pack(HEADER.size + len(payload), seconds & 0xFFFFFFFF, ns // 1000, sender, kind, 0)
    return header + payload + bytes(-len(payload) % 8)


def description(kind: int, number: int, name: bytes) -> bytes:
    """A sender's or a type's (`kind`) name and number."""
    return message(0, number, kind, _COUNT.pack(len(name) + 1) + name + b"\0")


def udp_description(address: str, port: int) -> bytes:
    """Where we hear datagrams."""
    return message(0, port, UDP_DESCRIPTION, address.encode() + b"\0")


def described(payload: bytes) -> bytes:
    """The name in a description; ProtocolError where its length cannot be right."""
    try:
        (count,) = _COUNT.unpack_from(payload)
    except error:
        raise ProtocolError("a description without a name") from None
    if not 1 <= count <= min(len(payload) - _COUNT.size, LONGEST_NAME):
        raise ProtocolError("a description whose name has another length than it says")
    return payload[_COUNT.size : _COUNT.size + count].partition(b"\0")[0]


class Stream:
    """Bytes of a TCP connection, or of one datagram, into messages. At most one message is kept waiting."""

    def __init__(self) -> None:
        self._rest = b""

    def messages(self, data: bytes) -> Iterator[Message]:
        """Those that are whole now; ProtocolError for a length that none has."""
        data = self._rest + data if self._rest else data
        at, end = 0, len(data)
        while end - at >= HEADER.size:
            length, seconds, us, sender, kind, _ = HEADER.unpack_from(data, at)
            if not HEADER.size <= length <= HEADER.size + LONGEST_PAYLOAD:
                raise ProtocolError("a message's length cannot be right")
            if at + length + (-length & 7) > end:
                break
            payload = data[at + HEADER.size : at + length]
            at += length + (-length & 7)
            self._rest = b""
            yield Message((seconds * 1_000_000 + us) * 1000, sender, kind, payload)
        self._rest = data[at:]

    @property
    def is_cut(self) -> bool:
        """Whether bytes wait for the rest of their message."""
        return bool(self._rest)

"""NatNet's small messages: header, hello, clock echo, requests. Every number is little-endian."""

from dataclasses import dataclass
from enum import IntEnum
from struct import Struct

from mocap.sources.natnet.reader import PacketError, Reader

Version = tuple[int, int]
OLDEST, NEWEST = (3, 0), (4, 2)
"""What is read. 4.0 put markers' names into descriptions; 4.1 byte counts, assets, precision time; 4.2 a rotation."""
BYTE_COUNTS = (4, 1)

_HEADER = Struct("<HH")
_NAME_BYTES = 256
_VERSIONS = Struct("<4B4B")
_CONNECTION = Struct("<QHB4s")
_ECHO, _ECHOED = Struct("<Q"), Struct("<QQ")
_OPTIONS = bytes(9)
"""Of a connection: all data, not only what was subscribed to; the newest version that the server speaks; padding."""
WHICH_VERSION = b"Bitstream\0"
"""Asks for the version of the stream; with a number behind it, it would set it."""


class MessageId(IntEnum):
    """What a packet is."""

    CONNECT = 0
    SERVER_INFO = 1
    REQUEST = 2
    RESPONSE = 3
    REQUEST_MODELS = 4
    MODELS = 5
    FRAME = 7
    KEEP_ALIVE = 10
    ECHO_REQUEST = 12
    ECHO_RESPONSE = 13
    DISCOVERY = 14
    UNRECOGNIZED = 100


@dataclass(frozen=True, slots=True)
class ServerInfo:
    """A server's description. clock_hz: of its high-resolution clock, the unit of stamps and echoes."""

    name: str
    app_version: tuple[int, ...]
    version: Version
    clock_hz: int
    data_port: int
    multicast: str | None

    @property
    def text(self) -> str:
        """For people."""
        app = ".".join(str(n) for n in self.app_version[:2])
        return f"{self.name} {app}, NatNet {self.version[0]}.{self.version[1]}"


def packet(message: MessageId, payload: bytes = b"") -> bytes:
    """A message with its header."""
    return _HEADER.pack(message, len(payload)) + payload


def unpack(data: bytes) -> tuple[int, bytes]:
    """A packet's message id, a MessageId where it is known, and its payload."""
    if len(data) < _HEADER.size:
        raise PacketError("packet: shorter than its header")
    message, size = _HEADER.unpack_from(data)
    if size != len(data) - _HEADER.size:
        raise PacketError("packet: of another length than its header says")
    return message, data[_HEADER.size :]


def hello(message: MessageId, name: str) -> bytes:
    """CONNECT, which takes the stream in the server's own version, or DISCOVERY, as by a client of 3.0: who asks."""
    who = name.encode()[: _NAME_BYTES - 1].ljust(_NAME_BYTES, b"\0")
    if message is MessageId.CONNECT:
        return packet(message, who + bytes(_VERSIONS.size) + _OPTIONS)
    return packet(message, who + _VERSIONS.pack(3, 0, 0, 0, 3, 0, 0, 0))


def echo_request(sent_ns: int) -> bytes:
    """Asks for the server's clock; `sent_ns` comes back."""
    return packet(MessageId.ECHO_REQUEST, _ECHO.pack(sent_ns))


def echo_response(payload: bytes) -> tuple[int, int]:
    """What was sent, and the server's clock when it came there, ticks."""
    if len(payload) != _ECHOED.size:
        raise PacketError("echo response: length: not 16 bytes")
    sent_ns, ticks = _ECHOED.unpack(payload)
    return sent_ns, ticks


def server_info(payload: bytes) -> ServerInfo:
    """The answer to CONNECT and DISCOVERY. PacketError also for a version older than 3.0, which has no clock."""
    reader = Reader(payload, "server info")
    start = reader.skip(_NAME_BYTES, "name")
    name = payload[start : start + _NAME_BYTES].partition(b"\0")[0].decode("utf-8", "replace")
    app, stream = (reader.fields(Struct("<4B"), "version") for _ in range(2))
    version = (int(stream[0]), int(stream[1]))
    if version < OLDEST:
        raise PacketError("server info: version: older than 3.0")
    clock_hz, data_port, is_multicast, group = reader.fields(_CONNECTION, "connection")
    if not clock_hz:
        raise PacketError("server info: clock frequency: zero")
    return ServerInfo(
        name,
        tuple(int(n) for n in app),
        version,
        int(clock_hz),
        int(data_port),
        ".".join(str(byte) for byte in bytes(group)) if is_multicast and isinstance(group, bytes) else None,
    )


def stream_version(payload: bytes) -> Version | None:
    """The version in an answer to WHICH_VERSION, "Bitstream,4.1.0"; None for any other answer."""
    word, _, numbers = payload.partition(b"\0")[0].decode("ascii", "replace").partition(",")
    parts = numbers.strip().split(".")
    if word.lower() != "bitstream" or len(parts) < 2 or not all(p.isdecimal() and len(p) < 4 for p in parts[:2]):
        return None
    return int(parts[0]), int(parts[1])

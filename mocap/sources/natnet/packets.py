"""NatNet's packets: header, hello, clock echo, requests; frames of mocap data; model definitions. Little-endian.

Of a frame its rigid bodies and exposure are read, of models the rigid bodies' names and ids; the rest is passed over.
Up to 4.0 a section can only be passed over by what is counted in it; from 4.1 each says its length in bytes.
"""

from dataclasses import dataclass
from enum import IntEnum, IntFlag
from struct import Struct
from typing import Any

import numpy as np
from numpy.typing import NDArray

_COUNT, _COUNTS = Struct("<i"), Struct("<ii")


class PacketError(ValueError):
    """The packet is no NatNet of the version agreed upon. Its text names message and field, and is one of few."""


class Reader:
    """A packet's payload and how far it is read. `message` is what errors call it."""

    __slots__ = ("_at", "_data", "_message")

    def __init__(self, data: bytes, message: str) -> None:
        self._data = data
        self._message = message
        self._at = 0

    @property
    def left(self) -> int:
        """Bytes not read yet."""
        return len(self._data) - self._at

    def fields(self, layout: Struct, what: str) -> tuple[int | float | bytes, ...]:
        """The fields of `layout`."""
        return layout.unpack_from(self._data, self.skip(layout.size, what))

    def integer(self, layout: Struct, what: str) -> int:
        """The one integer of `layout`."""
        number: int = layout.unpack_from(self._data, self.skip(layout.size, what))[0]
        return number

    def skip(self, size: int, what: str) -> int:
        """Leave out `size` bytes; where they begin."""
        at = self._at
        if not 0 <= size <= len(self._data) - at:
            raise self.error(what, "ends beyond the packet")
        self._at = at + size
        return at

    def count(self, least: int, what: str) -> int:
        """How many follow, each of `least` bytes at least."""
        count = self.integer(_COUNT, what)
        if not 0 <= count * least <= self.left:
            raise self.error(what, "more than the packet holds")
        return count

    def rows(self, each: int, what: str) -> tuple[int, int]:
        """A count, and so many of `each` bytes: the count, and where they begin."""
        count = self.count(each, what)
        return count, self.skip(count * each, what)

    def section(self, what: str) -> tuple[int, int, int]:
        """A count, a byte count, and so many bytes: both, and where these begin. In one, for there are many a frame."""
        at = self._at + _COUNTS.size
        left = len(self._data) - at
        if left < 0:
            raise self.error(what, "ends beyond the packet")
        count, size = _COUNTS.unpack_from(self._data, self._at)
        if count < 0 or not 0 <= size <= left:
            raise self.error(what, "more than the packet holds")
        self._at = at + size
        return count, size, at

    def text(self, what: str) -> str:
        """A text that a zero ends, 255 bytes at most."""
        end = self._data.find(b"\0", self._at, self._at + 256)
        if end < 0:
            raise self.error(what, "has no end")
        text = self._data[self._at : end].decode("utf-8", "replace")
        self._at = end + 1
        return text

    def whole(self) -> None:
        """PacketError unless everything is read."""
        if self.left:
            raise self.error("length", "longer than its content")

    def error(self, what: str, why: str) -> PacketError:
        """To be raised."""
        return PacketError(f"{self._message}: {what}: {why}")


Version = tuple[int, int]
OLDEST, NEWEST = (3, 0), (4, 2)
"""Versions that are read. 4.0 put marker names into descriptions; 4.1 byte counts, assets, time; 4.2 rotation."""
BYTE_COUNTS = (4, 1)

_HEADER = Struct("<HH")
_NAME_BYTES = 256
_VERSIONS = Struct("<4B4B")
_CONNECTION = Struct("<QHB4s")
_ECHO, _ECHOED = Struct("<Q"), Struct("<QQ")
_OPTIONS = bytes(9)
"""Options of a connection: all data, not only what was subscribed to; the server's newest version; padding."""
WHICH_VERSION = b"Bitstream\0"
"""Asks for the version of the stream; with a number behind it, it would set it."""


class MessageId(IntEnum):
    """The kind of a packet."""

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
    """The time that was sent, and the server's clock when it came there, ticks."""
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


BODY = np.dtype([("id", "<i4"), ("pose", "<f4", 7), ("error", "<f4"), ("params", "<i2")])
"""pose: x y z, quaternion x y z w."""


class BodyFlag(IntFlag):
    """Bits of a body's params."""

    TRACKED = 0x01
    """Seen in this frame."""


class FrameFlag(IntFlag):
    """Bits of a frame's params; EDITED: what was recorded is played, not what the cameras see."""

    MODELS_CHANGED = 0x02
    EDITED = 0x04
    VERSION_CHANGED = 0x08


MARKER_BYTES, POINT_BYTES, VALUE_BYTES = 26, 12, 4
_NUMBER = Struct("<i")
_SUFFIX = Struct("<2Id3QhI")
"""Timecode and its sub-frame, time stamp, mid-exposure, data received, transmit, params, end of data."""
_SUFFIX_PRECISE = Struct("<2Id3Q2IhI")
"""As well the precision time (PTP), seconds and fraction, before params."""
SECTIONS = ("marker sets", "other markers", "rigid bodies", "skeletons", "assets", "markers", "force plates", "devices")


@dataclass(frozen=True, slots=True, eq=False)
class Frame:
    """bodies: an array of BODY, metres. exposure_ticks: the middle of the exposure, 0 if cameras report none."""

    number: int
    bodies: NDArray[Any]
    exposure_ticks: int
    params: int


def frame_of_data(payload: bytes, version: Version) -> Frame:
    """PacketError where the payload is not exactly a frame of that version."""
    reader = Reader(payload, "frame of data")
    number = reader.integer(_NUMBER, "number")
    counted = version >= BYTE_COUNTS
    count, at = _sections_by_bytes(reader) if counted else _sections_by_counts(reader)
    suffix = reader.fields(_SUFFIX_PRECISE if counted else _SUFFIX, "suffix")
    reader.whole()
    bodies = np.frombuffer(payload, BODY, count, at) if count else np.empty(0, BODY)
    return Frame(number, bodies, int(suffix[3]), int(suffix[-2]))


def _sections_by_bytes(reader: Reader) -> tuple[int, int]:
    """The count of rigid bodies, and where they begin."""
    bodies = 0, 0
    for what in SECTIONS:
        count, size, at = reader.section(what)
        if what == "rigid bodies":
            if size != count * BODY.itemsize:
                raise reader.error(what, "count and byte count differ")
            bodies = count, at
    return bodies


def _sections_by_counts(reader: Reader) -> tuple[int, int]:
    for _ in range(reader.count(5, "marker sets")):
        reader.text("marker set name")
        reader.rows(POINT_BYTES, "marker set")
    reader.rows(POINT_BYTES, "other markers")
    bodies = reader.rows(BODY.itemsize, "rigid bodies")
    for _ in range(reader.count(8, "skeletons")):
        reader.skip(4, "skeletons")
        reader.rows(BODY.itemsize, "bones")
    reader.rows(MARKER_BYTES, "markers")
    for what in ("force plates", "devices"):
        for _ in range(reader.count(8, what)):
            reader.skip(4, what)
            for _ in range(reader.count(4, what)):
                reader.rows(VALUE_BYTES, what)
    return bodies


RIGID_BODY = 1
MARKER_NAMES, ROTATION = (4, 0), (4, 2)
"""The first versions to describe a body with them."""

_INT = Struct("<i")
_PLATE_BYTES = 4 * (2 + 3 + 12 * 12 + 4 * 3 + 2)
"""Width, length, origin, calibration matrix, corners, plate type, channel type."""


Named = list[tuple[int, str]]


def rigid_bodies(payload: bytes, version: Version) -> Named:
    """Streaming ids with names, in the server's order, as they are: several bodies may have one id, or one name.

    PacketError where the payload is not exactly descriptions.
    """
    reader = Reader(payload, "model definitions")
    names: Named = []
    for _ in range(reader.count(4, "descriptions")):
        kind = reader.integer(_INT, "type")
        if version >= BYTE_COUNTS:
            size = reader.count(1, "size")
            at = reader.skip(size, "description")
            if kind == RIGID_BODY:
                _named(Reader(payload[at : at + size], "model definitions"), names)
        elif kind == RIGID_BODY:
            _rigid_body(reader, version, names)
        else:
            _pass_over(reader, kind, version)
    reader.whole()
    return names


def _named(reader: Reader, names: Named) -> None:
    name = reader.text("rigid body name")
    names.append((reader.integer(_INT, "rigid body id"), name))


def _rigid_body(reader: Reader, version: Version, names: Named) -> None:
    """Name, id; then parent, offset, rotation, and of each marker position, active label, name."""
    _named(reader, names)
    reader.skip(16 + 16 * (version >= ROTATION), "rigid body")
    markers, _ = reader.rows(16, "rigid body's markers")
    if version >= MARKER_NAMES:
        _texts(reader, markers, "rigid body's marker name")


def _pass_over(reader: Reader, kind: int, version: Version) -> None:
    match kind:
        case 0:  # a marker set
            reader.text("marker set name")
            _texts(reader, reader.count(1, "marker set"), "marker name")
        case 2:  # a skeleton
            reader.text("skeleton name")
            reader.skip(4, "skeleton")
            for _ in range(reader.count(25, "bones")):
                _rigid_body(reader, version, [])
        case 3:  # a force plate
            reader.skip(4, "force plate")
            reader.text("force plate's serial number")
            reader.skip(_PLATE_BYTES, "force plate")
            _texts(reader, reader.count(1, "force plate"), "channel name")
        case 4:  # a device
            reader.skip(4, "device")
            _texts(reader, 2, "device name")
            reader.skip(8, "device")
            _texts(reader, reader.count(1, "device"), "channel name")
        case 5:  # a camera
            reader.text("camera name")
            reader.skip(28, "camera")
        case _:
            raise reader.error("type", "not known to this version")


def _texts(reader: Reader, count: int, what: str) -> None:
    for _ in range(count):
        reader.text(what)

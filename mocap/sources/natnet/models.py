"""Model definitions: which rigid body has which name. Ids alone are in the frames."""

from struct import Struct

from mocap.sources.natnet.messages import BYTE_COUNTS, Version
from mocap.sources.natnet.reader import Reader

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

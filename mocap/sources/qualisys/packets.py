"""QTM's packets as they lie in the stream, judged before `qtm-rt` reads them. Pure.

`qtm-rt` believes what it reads: a packet or component of size 0 keeps it busy for ever. So sizes, types and counts are
looked at first. Source: QTM RT protocol documentation, "QTM RT Packets", and "6DOF components" (little endian).
"""

import struct
from dataclasses import dataclass
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray
from qtm_rt.packet import QRTComponentType, QRTPacket, QRTPacketType

from mocap.sources.tcp import ProtocolError
from wire.transport.frame_check import MOST_BODIES

HEADER = struct.Struct("<II")
DATA_HEADER = struct.Struct("<qII")
BODIES = struct.Struct("<ihh")
BODY_FLOATS = 12
LARGEST_PACKET = 1 << 20
MOST_COMPONENTS = 32


@dataclass(frozen=True, slots=True, eq=False)
class SixD:
    """One exposure's bodies. stamp_us: since QTM's start; rows (n, 12): x y z, matrix by columns; NaN: lost."""

    stamp_us: int
    number: int
    rows: NDArray[np.float32]


class Stream:
    """Cuts the bytes that come into packets."""

    def __init__(self) -> None:
        self._data = bytearray()

    def receive(self, data: bytes) -> list[tuple[QRTPacketType, bytes]]:
        """The packets that are complete now, without their headers; ProtocolError where the stream is none."""
        self._data += data
        packets, start = [], 0
        while len(self._data) - start >= HEADER.size:
            size, kind = HEADER.unpack_from(self._data, start)
            if not HEADER.size <= size <= LARGEST_PACKET:
                raise ProtocolError("packet header: a size that no packet has")
            if kind > QRTPacketType.PacketQTMFile.value:
                raise ProtocolError("packet header: a type that no packet has")
            if len(self._data) - start < size:
                break
            packets.append((QRTPacketType(kind), bytes(self._data[start + HEADER.size : start + size])))
            start += size
        del self._data[:start]
        return packets


def text_of(packet: bytes) -> str:
    """What a command, error or XML packet says."""
    return packet.rstrip(b"\0").decode("utf-8", "replace")


def bodies_of(packet: bytes) -> SixD | None:
    """A data packet's bodies, None where it has none; ValueError says why it cannot be read."""
    if len(packet) < DATA_HEADER.size:
        raise ValueError("data packet: cut short")
    if DATA_HEADER.unpack_from(packet)[2] > MOST_COMPONENTS:
        raise ValueError("data packet: a component count that no packet has")
    try:
        read = QRTPacket(packet)
    except (struct.error, ValueError) as error:
        raise ValueError("data packet: components that cannot be read") from error
    start = read.components.get(QRTComponentType.Component6d)
    if start is None:
        return None
    if len(packet) < start + BODIES.size:
        raise ValueError("6D component: cut short")
    size = HEADER.unpack_from(packet, start - HEADER.size)[0]
    n = BODIES.unpack_from(packet, start)[0]
    if not 0 <= n <= MOST_BODIES:
        raise ValueError("6D component: a body count that no laboratory has")
    whole = HEADER.size + BODIES.size + 4 * BODY_FLOATS * n
    if size != whole or len(packet) < start - HEADER.size + whole:
        raise ValueError("6D component: body count and size do not agree")
    rows = np.frombuffer(packet, "<f4", BODY_FLOATS * n, start + BODIES.size).reshape(n, BODY_FLOATS)
    return SixD(read.timestamp, read.framenumber, rows)


def names_of(parameters: str, *, also_off: bool = True) -> tuple[str, ...]:
    """The bodies' names in the order of the 6D component, from the 6D parameters; ValueError if they cannot be read.

    also_off: those, too, that are not enabled.
    """
    if "<!DOCTYPE" in parameters:
        raise ValueError("6D parameters: a document type, which QTM does not send")
    try:
        root = ElementTree.fromstring(parameters)
    except (ElementTree.ParseError, ValueError) as error:
        raise ValueError("6D parameters: not XML") from error
    bodies = root.findall("The_6D/Body")
    if len(bodies) > MOST_BODIES:
        raise ValueError("6D parameters: more bodies than any laboratory has")
    bodies = [body for body in bodies if also_off or (body.findtext("Enabled") or "true").strip().lower() != "false"]
    names = tuple((body.findtext("Name") or "").strip() for body in bodies)
    if not all(names):
        raise ValueError("6D parameters: a body without a name")
    return names

"""Qualisys Track Manager as a source: its packets, one connection's session, and the client that has one after another.

`qtm-rt` reads packets and believes them: one of size 0, or a component of size 0, keeps it busy for ever. So sizes,
types and counts are looked at first. Source: QTM RT protocol documentation, "QTM RT Packets", and "6DOF components"
(little endian). A session asks for version, names and stream, and for the names again when they change. Sans-IO.
"""

import struct
from collections.abc import Callable
from dataclasses import dataclass
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray
from qtm_rt.packet import QRTComponentType, QRTEvent, QRTPacket, QRTPacketType

from formation.messages import RawFrame, Severity
from formation.mocap_config import QualisysConfig
from mocap.capture_time import CaptureTime
from mocap.sources.numbered import NumberedFrames
from mocap.sources.poses import from_matrices
from mocap.sources.source import Feed, SourceStatus
from mocap.sources.tcp import ANSWER_NS, LARGEST_PACKET, ProtocolError, TcpClient
from wire.transport.frame_check import MOST_BODIES

HEADER = struct.Struct("<II")
DATA_HEADER = struct.Struct("<qII")
BODIES = struct.Struct("<ihh")
BODY_FLOATS = 12


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
    """The text of a command, error or XML packet."""
    return packet.rstrip(b"\0").decode("utf-8", "replace")


def bodies_of(packet: bytes) -> SixD | None:
    """A data packet's bodies, None where it has none; ValueError says why it cannot be read."""
    if len(packet) < DATA_HEADER.size:
        raise ValueError("data packet: cut short")
    if DATA_HEADER.unpack_from(packet)[2] > 32:
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


VERSION = "1.19"
"""The oldest in wide use; QTM serves every older one too."""
WELCOME = "QTM RT Interface connected"
AGAIN_NS, SOON_NS = 1_000_000_000, 100_000_000
"""Period of asking for the names: QTM may rename a body without an event, or may have gone silent."""
RENAMING = (QRTEvent.EventCameraSettingsChanged, QRTEvent.EventConnected, QRTEvent.EventRTfromFileStarted)
SHUTTING_DOWN = QRTEvent.EventQTMShuttingDown


def command(text: str) -> bytes:
    """A command's packet."""
    data = text.encode() + b"\0"
    return HEADER.pack(HEADER.size + len(data), QRTPacketType.PacketCommand.value) + data


class QualisysSession:
    """Delivers frames to `deliver` after their names to `named`; none while it asks QTM for the names again."""

    def __init__(
        self,
        deliver: Callable[[SixD, int], None],
        named: Callable[[tuple[str, ...]], object],
        feed: Feed,
        now_ns: int,
    ) -> None:
        self._deliver = deliver
        self._named = named
        self._feed = feed
        self._stream = Stream()
        self._names: tuple[tuple[str, ...], ...] | None = None
        """The names of all bodies, and of those that are enabled: a frame may hold either."""
        self._rows: int | None = None
        self._off: tuple[str, ...] = ()
        self._version = self._streaming = self._idle = False
        self._opened_ns = self._asked_ns = now_ns
        self._reported: set[str] = set()

    def received(self, data: bytes, now_ns: int) -> bytes:
        """Take the next bytes; what to answer. ProtocolError where the connection cannot go on."""
        return b"".join(self._packet(kind, packet, now_ns) for kind, packet in self._stream.receive(data))

    def due(self, now_ns: int) -> bytes:
        """The names again, once a second. ProtocolError where QTM answers nothing that is of use."""
        if self._version:
            return self._ask(now_ns) if now_ns - self._asked_ns >= AGAIN_NS else b""
        if now_ns - self._opened_ns > ANSWER_NS:
            raise ProtocolError("no answer to the version asked for")
        return b""

    def _packet(self, kind: QRTPacketType, packet: bytes, now_ns: int) -> bytes:
        match kind:
            case QRTPacketType.PacketData:
                return self._frame(packet, now_ns)
            case QRTPacketType.PacketXML:
                return self._parameters(text_of(packet))
            case QRTPacketType.PacketCommand | QRTPacketType.PacketError:
                return self._answer(text_of(packet), now_ns)
            case QRTPacketType.PacketEvent:
                return self._event(packet, now_ns)
            case QRTPacketType.PacketNoMoreData:
                self._rest()
        return b""

    def _answer(self, text: str, now_ns: int) -> bytes:
        if text.startswith(WELCOME):
            return command(f"Version {VERSION}")
        if text.startswith("Version set to"):
            self._version = True
            return self._ask(now_ns)
        if "NOT supported" in text:
            raise ProtocolError(f"QTM does not know version {VERSION} of its protocol: update QTM")
        if text.startswith("Connection refused"):
            raise ProtocolError("QTM has as many clients as it takes")
        if text.startswith("Parameters not available"):
            return self._receive_names(())
        self._feed.reject("an answer that was not expected")
        if text not in self._reported and len(self._reported) < 8:
            self._reported.add(text)
            self._feed.report(Severity.WARNING, f"QTM says: {text}")
        return b""

    def _parameters(self, text: str) -> bytes:
        try:
            return self._receive_names(names_of(text), names_of(text, also_off=False))
        except ValueError as error:
            self._feed.reject(str(error))
            return b""

    def _receive_names(self, *names: tuple[str, ...]) -> bytes:
        self._names = names
        self._name_rows(self._fitting() or names[0])
        if self._streaming:
            return b""
        self._streaming = True
        return command("StreamFrames AllFrames 6D")

    def _fitting(self) -> tuple[str, ...] | None:
        """The names of as many bodies as the newest frame had; None where no list has as many."""
        return next((names for names in self._names or () if len(names) == self._rows), None)

    def _name_rows(self, names: tuple[str, ...]) -> None:
        self._named(names)
        off = tuple(name for name in (self._names or ((),))[0] if name not in names)
        if off != self._off:
            self._off = off
            if off:
                self._feed.report(Severity.WARNING, f"not enabled in QTM, and not in its frames: {', '.join(off)}")

    def _event(self, packet: bytes, now_ns: int) -> bytes:
        if packet[:1] == bytes([SHUTTING_DOWN.value]):
            self._feed.report(Severity.WARNING, "QTM is shutting down")
        if self._version and packet[:1] in [bytes([event.value]) for event in RENAMING]:
            self._names = None  # an index may mean another body now
            return self._ask(now_ns)
        return b""

    def _rest(self) -> None:
        if not self._idle:
            self._idle = True
            self._feed.report(Severity.WARNING, "QTM measures nothing: start a measurement or its real-time preview")

    def _ask(self, now_ns: int) -> bytes:
        self._asked_ns = now_ns
        return command("GetParameters 6D")

    def _frame(self, packet: bytes, now_ns: int) -> bytes:
        try:
            frame = bodies_of(packet)
        except ValueError as error:
            self._feed.reject(str(error))
            return b""
        if frame is None:
            self._feed.reject("data packet: no 6D component")
        elif self._names is None:
            self._feed.reject("a frame while the bodies' names are asked for")
        elif not self._fits(len(frame.rows)):
            self._feed.reject("a frame of more or fewer bodies than are named")
            self._names = None
            return self._ask(now_ns) if now_ns - self._asked_ns > SOON_NS else b""
        else:
            self._idle = False
            self._deliver(frame, now_ns)
        return b""

    def _fits(self, rows: int) -> bool:
        """Whether the names of a frame of so many bodies are known; from now on they are these."""
        changed, self._rows = rows != self._rows, rows
        names = self._fitting()
        if names is not None and changed:
            self._name_rows(names)
        return names is not None


class Qualisys:
    """One QTM's client. lab: the bodies that are expected; latency_ns: from exposure to receipt, which QTM keeps."""

    def __init__(self, config: QualisysConfig, lab: tuple[str, ...], latency_ns: int, feed: Feed) -> None:
        self._feed = feed
        self._frames = NumberedFrames(f"QTM at {config.host}:{config.port}", lab, feed)
        self._time = CaptureTime(latency_ns)
        self._client = TcpClient(config.host, config.port, self, feed)

    async def run(self) -> None:
        """Take frames until cancelled."""
        await self._client.run()

    def status(self) -> SourceStatus:
        """How it is doing."""
        now_ns = self._feed.clock.monotonic_ns()
        return self._frames.status(self._client.connected, self._time.uncertainty_ns(now_ns), latency_measured=False)

    def open(self, now_ns: int, _ours: str, _theirs: str) -> tuple[QualisysSession, bytes]:
        """A new connection's session; QTM speaks first."""
        return QualisysSession(self._receive, self._frames.body_list.receive, self._feed, now_ns), b""

    def _receive(self, frame: SixD, now_ns: int) -> None:
        seq = self._frames.number(frame.number)
        if seq is None:
            return
        t_capture_ns = self._time.capture_ns(frame.stamp_us * 1000, now_ns)
        self._frames.latency_ns = now_ns - t_capture_ns
        placed = from_matrices(frame.rows, by_columns=True, unit_m=self._feed.unit_m, lost_is_nan=True)
        self._feed.deliver(RawFrame(seq, t_capture_ns, self._frames.body_list.bodies, *placed))

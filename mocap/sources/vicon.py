"""Vicon DataStream, as Tracker, Nexus and Shogun serve it over TCP: packets, a connection's session, the client.

A packet is a tag, a length and blocks; a block is a kind, a length and one object. All little endian. Source: the
stream classes that Vicon publishes with its DataStream SDK (Enum.h, SubjectInfo.h, GlobalSegments.h and others).

A session says what is wanted, then takes every frame the server pushes. Sans-IO, time an argument.
"""

import math
import struct
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from formation.messages import RawFrame
from formation.mocap_config import ViconConfig
from mocap.capture_time import CaptureTime
from mocap.sources.numbered import NumberedFrames
from mocap.sources.poses import from_matrices
from mocap.sources.source import Feed, SourceStatus
from mocap.sources.tcp import ANSWER_NS, LARGEST_PACKET, ProtocolError, TcpClient
from wire.transport.frame_check import MOST_BODIES

HEADER = struct.Struct("<II")
STREAM_TAG = 0x1A2B0001
MOST_BLOCKS = 4 * MOST_BODIES
TICKS_HZ = 135_000_000
SEGMENT = struct.Struct("<I12d")
"""Identifier; translation, mm; rotation, rows first."""
_U32, _I64 = struct.Struct("<I"), struct.Struct("<q")
_PARENTAGE = struct.Struct("<II6f")

Block = tuple[int, bytes]


class Kind(IntEnum):
    """The content of a block."""

    STREAM_INFO = 1
    SUBJECT_INFO = 2
    FRAME_INFO = 5
    GLOBAL_SEGMENTS = 9
    LATENCY_INFO = 26
    APPLICATION_INFO = 37
    FRAME_RATE_INFO = 39
    PING = 42
    OBJECT_ENUMS = 100001
    REQUEST_FRAME = 100002
    CONTENTS = 100004


class Stream:
    """Cuts the bytes that come into packets."""

    def __init__(self) -> None:
        self._data = bytearray()

    def receive(self, data: bytes) -> list[bytes]:
        """The packets that are complete now, without their headers; ProtocolError where the stream is none."""
        self._data += data
        packets, start = [], 0
        while len(self._data) - start >= HEADER.size:
            tag, size = HEADER.unpack_from(self._data, start)
            if tag != STREAM_TAG:
                raise ProtocolError("packet header: not that of a packet of objects")
            if size > LARGEST_PACKET:
                raise ProtocolError("packet header: a length that no packet has")
            end = start + HEADER.size + size
            if len(self._data) < end:
                break
            packets.append(bytes(self._data[start + HEADER.size : end]))
            start = end
        del self._data[:start]
        return packets


def packet_of(*blocks: Block) -> bytes:
    """A packet of these blocks."""
    body = b"".join(HEADER.pack(kind, len(data)) + data for kind, data in blocks)
    return HEADER.pack(STREAM_TAG, len(body)) + body


def blocks_of(packet: bytes) -> list[Block]:
    """A packet's blocks; ValueError where their lengths are not the packet's."""
    blocks: list[Block] = []
    at, whole = 0, len(packet)
    while at < whole:
        if whole - at < HEADER.size:
            raise ValueError("block header: cut short")
        kind, size = HEADER.unpack_from(packet, at)
        at += HEADER.size + size
        if at > whole:
            raise ValueError("block header: a length beyond the packet")
        blocks.append((kind, packet[at - size : at]))
        if len(blocks) > MOST_BLOCKS:
            raise ValueError("packet: more blocks than any packet has")
    return blocks


def set_of(kinds: Iterable[int]) -> bytes:
    """Kinds as a set is written: their number, then each in order."""
    ordered = sorted(kinds)
    return struct.pack(f"<I{len(ordered)}I", len(ordered), *ordered)


def kinds_of(data: bytes) -> frozenset[int]:
    """The kinds that ObjectEnums lists."""
    n = _u32(data, 0, "ObjectEnums")
    if n > (len(data) - _U32.size) // _U32.size:
        raise ValueError("ObjectEnums: a count beyond the block")
    return frozenset(struct.unpack_from(f"<{n}I", data, _U32.size))


def unchanged_of(data: bytes) -> frozenset[int]:
    """The kinds that Contents says are as before, and so not sent; behind a table of counts."""
    counts = _u32(data, 0, "Contents")
    start = _U32.size + HEADER.size * counts
    if start > len(data):
        raise ValueError("Contents: a count beyond the block")
    return kinds_of(data[start:])


def number_of(data: bytes) -> int:
    """FrameInfo's frame number."""
    return _u32(data, 0, "FrameInfo")


def period_of(data: bytes) -> int:
    """StreamInfo's frame period, in ticks of TICKS_HZ: of 1 to 10,000 Hz."""
    if len(data) < _I64.size:
        raise ValueError("StreamInfo: cut short")
    ticks: int = _I64.unpack_from(data)[0]
    if not TICKS_HZ // 10_000 <= ticks <= TICKS_HZ:
        raise ValueError("StreamInfo: a frame period that no camera has")
    return ticks


def subject_of(data: bytes) -> tuple[int, str, bytes]:
    """SubjectInfo: identifier, name, and its root segment's identifier, as it is written; there the body is."""
    identifier = _u32(data, 0, "SubjectInfo")
    name, at = _text(data, _U32.size, "SubjectInfo")
    if _u32(data, at, "SubjectInfo") == 0:
        raise ValueError("SubjectInfo: a subject without a segment")
    at += _U32.size
    if len(data) - at < _PARENTAGE.size:
        raise ValueError("SubjectInfo: cut short")
    # Segments come parents first; the identifier follows the parent's.
    return identifier, name, data[at + _U32.size : at + 2 * _U32.size]


def root_of(data: bytes, roots: Mapping[int, bytes]) -> tuple[int, bytes | None]:
    """GlobalSegments: whose they are, and its root among them, as SEGMENT; None where that is out of sight.

    roots: the root segment's identifier, as it is written, by the subject's.
    """
    if len(data) < HEADER.size:
        raise ValueError("GlobalSegments: cut short")
    subject, n = HEADER.unpack_from(data)
    if HEADER.size + n * SEGMENT.size != len(data):
        raise ValueError("GlobalSegments: count and length do not agree")
    root = roots.get(subject)
    if root is None:
        raise ValueError("GlobalSegments: a subject that is not named")
    for at in range(HEADER.size, len(data), SEGMENT.size):
        if data.startswith(root, at):
            return subject, data[at : at + SEGMENT.size]
    return subject, None


def latency_of(data: bytes) -> float:
    """LatencyInfo: the sum of its samples, s, from exposure to sending; each is called and counted from the last."""
    total, at = 0.0, _U32.size
    for _ in range(min(_u32(data, 0, "LatencyInfo"), len(data))):
        _, at = _text(data, at, "LatencyInfo")
        if len(data) - at < 8:
            raise ValueError("LatencyInfo: cut short")
        total += struct.unpack_from("<d", data, at)[0]
        at += 8
    if not (math.isfinite(total) and 0.0 <= total <= 1.0):
        raise ValueError("LatencyInfo: not between 0 and 1 s")
    return total


def _u32(data: bytes, at: int, what: str) -> int:
    if len(data) - at < _U32.size:
        raise ValueError(f"{what}: cut short")
    value: int = _U32.unpack_from(data, at)[0]
    return value


def _text(data: bytes, at: int, what: str) -> tuple[str, int]:
    """A string and where it ends."""
    start = at + _U32.size
    size = _u32(data, at, what)
    if size > len(data) - start:
        raise ValueError(f"{what}: a text beyond the block")
    return data[start : start + size].decode("utf-8", "replace"), start + size


ROW = np.dtype([("identifier", "<u4"), ("row", "<f8", 12)])
LOST = bytes(SEGMENT.size)
"""Instead of a body out of sight, which some programs send themselves: it is at exactly zero."""
Rows = NDArray[np.float64]


def rows_of(segments: Sequence[bytes | None]) -> Rows:
    """Position, mm, and matrix, rows first, of each segment as SEGMENT (n, 12); zeros of one that is lost."""
    table: NDArray[Any] = np.frombuffer(b"".join([segment or LOST for segment in segments]), ROW)
    rows: Rows = table["row"]
    return rows


WANTED = frozenset(
    {Kind.CONTENTS, Kind.STREAM_INFO, Kind.SUBJECT_INFO, Kind.FRAME_INFO, Kind.GLOBAL_SEGMENTS, Kind.LATENCY_INFO}
)
PING_NS = 1_000_000_000
"""A server whose cameras are paused still answers."""
T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class ViconFrame:
    """One exposure. rows: each subject's place and matrix, as `rows_of`, in the subjects' order.

    period: in ticks, None while the server has not said it; latency_s: from exposure to sending, likewise.
    """

    number: int
    period: int | None
    latency_s: float | None
    rows: Rows


class ViconSession:
    """Frames go to `deliver`, the subjects' names before them to `named`, whenever they change."""

    def __init__(
        self,
        deliver: Callable[[ViconFrame, int], None],
        named: Callable[[tuple[str, ...]], object],
        feed: Feed,
        now_ns: int,
    ) -> None:
        self._deliver = deliver
        self._named = named
        self._feed = feed
        self._stream = Stream()
        self._offered: frozenset[int] = frozenset()
        self._roots: dict[int, bytes] = {}
        self._segments: dict[int, bytes] = {}
        self._period: int | None = None
        self._latency_s: float | None = None
        self._opened_ns = self._pinged_ns = now_ns
        self._pings = 0

    def received(self, data: bytes, now_ns: int) -> bytes:
        """Take the next bytes; what to answer. ProtocolError where the connection cannot go on."""
        answers = []
        for packet in self._stream.receive(data):
            try:
                answers.append(self._packet(blocks_of(packet), now_ns))
            except ProtocolError:
                raise
            except ValueError as error:
                self._feed.reject(str(error))
        return b"".join(answers)

    def due(self, now_ns: int) -> bytes:
        """A ping each second. ProtocolError where the server does not say what it offers."""
        if not self._offered and now_ns - self._opened_ns > ANSWER_NS:
            raise ProtocolError("no list of what is offered")
        if Kind.PING not in self._offered or now_ns - self._pinged_ns < PING_NS:
            return b""
        self._pinged_ns = now_ns
        self._pings += 1
        return packet_of((Kind.PING, struct.pack("<Q", self._pings)))

    def _packet(self, blocks: list[Block], now_ns: int) -> bytes:
        of: dict[int, list[bytes]] = {}
        for kind, data in blocks:
            of.setdefault(kind, []).append(data)
        if Kind.STREAM_INFO in of:
            self._period = self._read(period_of, of[Kind.STREAM_INFO][-1], self._period)
        if Kind.SUBJECT_INFO in of:
            self._name([subject_of(data) for data in of[Kind.SUBJECT_INFO]])
        if Kind.LATENCY_INFO in of:
            self._latency_s = self._read(latency_of, of[Kind.LATENCY_INFO][-1], self._latency_s)
        if Kind.FRAME_INFO in of:
            self._frame(of, now_ns)
        return self._want(kinds_of(of[Kind.OBJECT_ENUMS][-1])) if Kind.OBJECT_ENUMS in of else b""

    def _want(self, offered: frozenset[int]) -> bytes:
        if Kind.GLOBAL_SEGMENTS not in offered or Kind.FRAME_INFO not in offered:
            raise ProtocolError("the server offers no segments of its subjects")
        self._offered = offered
        wanted = packet_of((Kind.OBJECT_ENUMS, set_of(WANTED & offered)))
        return wanted + packet_of((Kind.REQUEST_FRAME, b"\1"))

    def _name(self, subjects: list[tuple[int, str, bytes]]) -> None:
        roots = {identifier: root for identifier, _, root in subjects}
        if len(roots) < len(subjects):
            raise ValueError("SubjectInfo: two subjects with one identifier")
        self._roots = roots
        self._named(tuple(name for _, name, _ in subjects))

    def _frame(self, of: Mapping[int, list[bytes]], now_ns: int) -> None:
        number = number_of(of[Kind.FRAME_INFO][-1])
        unchanged = unchanged_of(of[Kind.CONTENTS][-1]) if Kind.CONTENTS in of else frozenset()
        if Kind.GLOBAL_SEGMENTS not in unchanged:
            self._segments = self._segments_of(of.get(Kind.GLOBAL_SEGMENTS, []))
        rows = rows_of([self._segments.get(identifier) for identifier in self._roots])
        self._deliver(ViconFrame(number, self._period, self._latency_s, rows), now_ns)

    def _segments_of(self, blocks: list[bytes]) -> dict[int, bytes]:
        """Each subject's root; one that cannot be read is lost, not the others."""
        segments = {}
        for data in blocks:
            try:
                identifier, segment = root_of(data, self._roots)
            except ValueError as error:
                self._feed.reject(str(error))
                continue
            if segment is not None:
                segments[identifier] = segment
        return segments

    def _read(self, read: Callable[[bytes], T], data: bytes, otherwise: T) -> T:
        try:
            return read(data)
        except ValueError as error:
            self._feed.reject(str(error))
            return otherwise


class Vicon:
    """One server's client. lab: the bodies that are expected; latency_ns: where the server does not report its own.

    The exposures' times are those of a clock that counts frame periods; the latency the server reports with a frame is
    taken off its arrival first, so that what is left is the network's.
    """

    def __init__(self, config: ViconConfig, lab: tuple[str, ...], latency_ns: int, feed: Feed) -> None:
        self._latency_ns = latency_ns
        self._feed = feed
        self._frames = NumberedFrames(f"Vicon at {config.host}:{config.port}", lab, feed)
        self._period: int | None = None
        self._time = CaptureTime(0)
        self._sent_ns = 0
        self._latency_measured = False
        self._client = TcpClient(config.host, config.port, self, feed)

    async def run(self) -> None:
        """Take frames until cancelled."""
        await self._client.run()

    def status(self) -> SourceStatus:
        """How it is doing."""
        return self._frames.status(
            self._client.connected, self._time.uncertainty_ns(self._sent_ns), self._latency_measured
        )

    def open(self, now_ns: int, _ours: str, _theirs: str) -> tuple[ViconSession, bytes]:
        """A new connection's session; the server speaks first."""
        return ViconSession(self._receive, self._frames.body_list.receive, self._feed, now_ns), b""

    def _receive(self, frame: ViconFrame, now_ns: int) -> None:
        seq, bodies = self._frames.number(frame.number), self._frames.body_list.bodies
        if seq is None or len(frame.rows) != len(bodies):  # its connection has not named its subjects yet
            return
        t_capture_ns = self._capture_ns(frame, now_ns)
        placed = from_matrices(frame.rows, by_columns=False, unit_m=self._feed.unit_m, lost_is_nan=False)
        self._feed.deliver(RawFrame(seq, t_capture_ns, bodies, *placed))

    def _capture_ns(self, frame: ViconFrame, now_ns: int) -> int:
        """0, for a frame without a stamp, as long as the frame period is not known."""
        if frame.period is None:
            return 0
        if frame.period != self._period:
            self._period, self._time = frame.period, CaptureTime(0)
        self._latency_measured = frame.latency_s is not None
        latency_ns = self._latency_ns if frame.latency_s is None else round(1e9 * frame.latency_s)
        # Frames come in order: a latency that leaps must not turn it round.
        self._sent_ns = max(self._sent_ns, now_ns - latency_ns)
        stamp_ns = frame.number * frame.period * 1_000_000_000 // TICKS_HZ
        t_capture_ns = self._time.capture_ns(stamp_ns, self._sent_ns)
        self._frames.latency_ns = now_ns - t_capture_ns
        return t_capture_ns

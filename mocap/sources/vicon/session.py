"""A Vicon DataStream server as a source: one connection's session, and the client that has one after another.

A session says what is wanted, then takes every frame the server pushes. Sans-IO, time an argument.
"""

import struct
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TypeVar

from formation.mocap_config import ViconConfig
from mocap.capture_time import CaptureTime
from mocap.sources.numbered import NumberedFrames
from mocap.sources.poses import from_matrices
from mocap.sources.source import Feed, SourceStatus
from mocap.sources.tcp import ANSWER_NS, ProtocolError, TcpClient
from mocap.sources.vicon import packets
from mocap.sources.vicon.packets import TICKS_HZ, Block, Kind, Layout, Rows, is_plain, rows_of

WANTED = frozenset(
    {Kind.CONTENTS, Kind.STREAM_INFO, Kind.SUBJECT_INFO, Kind.FRAME_INFO, Kind.GLOBAL_SEGMENTS, Kind.LATENCY_INFO}
)
PING_NS = 1_000_000_000
"""A server whose cameras are paused still answers."""
T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class ViconFrame:
    """One exposure. rows: each subject's place and matrix, as `packets.rows_of`, in the subjects' order.

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
        named: Callable[[tuple[str, ...]], None],
        feed: Feed,
        now_ns: int,
    ) -> None:
        self._deliver = deliver
        self._named = named
        self._feed = feed
        self._stream = packets.Stream()
        self._offered: frozenset[int] = frozenset()
        self._roots: dict[int, bytes] = {}
        self._segments: dict[int, bytes] = {}
        self._layout: Layout | None = None
        self._newest = b""
        """The packet that was read by its layout, where one was since the segments were."""
        self._period: int | None = None
        self._latency_s: float | None = None
        self._opened_ns = self._pinged_ns = now_ns
        self._pings = self._rejected = self._size = 0

    def received(self, data: bytes, now_ns: int) -> bytes:
        """Take the next bytes; what to answer. ProtocolError where the connection cannot go on."""
        answers = []
        for packet in self._stream.receive(data):
            try:
                if not self._read_by_layout(packet, now_ns):
                    answers.append(self._packet(packets.blocks_of(packet), now_ns))
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
        return packets.packet_of((Kind.PING, struct.pack("<Q", self._pings)))

    def _read_by_layout(self, packet: bytes, now_ns: int) -> bool:
        """Whether it is laid out as the one before, which spares nearly all of the work."""
        layout = self._layout
        rows = None if layout is None else layout.rows(packet)
        if layout is None or rows is None:
            return False
        changed = {kind: [packet[where]] for kind, where in layout.changing.items()}
        number = packets.number_of(changed[Kind.FRAME_INFO][-1])
        self._newest = packet
        self._receive_latency(changed)
        self._deliver(ViconFrame(number, self._period, self._latency_s, rows), now_ns)
        return True

    def _packet(self, blocks: list[Block], now_ns: int) -> bytes:
        self._layout = None
        if self._newest:
            before = [data for kind, data in packets.blocks_of(self._newest) if kind == Kind.GLOBAL_SEGMENTS]
            self._newest, self._segments = b"", self._segments_of(before)
        of: dict[int, list[bytes]] = {}
        for kind, data in blocks:
            of.setdefault(kind, []).append(data)
        if Kind.STREAM_INFO in of:
            self._period = self._read(packets.period_of, of[Kind.STREAM_INFO][-1], self._period)
        if Kind.SUBJECT_INFO in of:
            self._name([packets.subject_of(data) for data in of[Kind.SUBJECT_INFO]])
        self._receive_latency(of)
        if Kind.FRAME_INFO in of and self._frame(of, now_ns) and is_plain([kind for kind, _ in blocks]):
            size = sum(len(data) for _, data in blocks)
            if size == self._size:  # laid out the same twice: it may well be again
                self._layout = Layout(blocks, self._roots)
            self._size = size
        return self._want(packets.kinds_of(of[Kind.OBJECT_ENUMS][-1])) if Kind.OBJECT_ENUMS in of else b""

    def _want(self, offered: frozenset[int]) -> bytes:
        if Kind.GLOBAL_SEGMENTS not in offered or Kind.FRAME_INFO not in offered:
            raise ProtocolError("the server offers no segments of its subjects")
        self._offered = offered
        wanted = packets.packet_of((Kind.OBJECT_ENUMS, packets.set_of(WANTED & offered)))
        return wanted + packets.packet_of((Kind.REQUEST_FRAME, b"\1"))

    def _name(self, subjects: list[tuple[int, str, bytes]]) -> None:
        roots = {identifier: root for identifier, _, root in subjects}
        if len(roots) < len(subjects):
            raise ValueError("SubjectInfo: two subjects with one identifier")
        self._roots = roots
        self._named(tuple(name for _, name, _ in subjects))

    def _receive_latency(self, of: Mapping[int, list[bytes]]) -> None:
        if Kind.LATENCY_INFO in of:
            self._latency_s = self._read(packets.latency_of, of[Kind.LATENCY_INFO][-1], self._latency_s)

    def _frame(self, of: Mapping[int, list[bytes]], now_ns: int) -> bool:
        """Whether it has segments of its own, and all of them could be read."""
        number = packets.number_of(of[Kind.FRAME_INFO][-1])
        unchanged = packets.unchanged_of(of[Kind.CONTENTS][-1]) if Kind.CONTENTS in of else frozenset()
        blocks = of.get(Kind.GLOBAL_SEGMENTS, [])
        is_whole = Kind.GLOBAL_SEGMENTS not in unchanged
        if is_whole:
            rejected_before = self._rejected
            self._segments = self._segments_of(blocks)
            is_whole = rejected_before == self._rejected
        rows = rows_of([self._segments.get(identifier) for identifier in self._roots])
        self._deliver(ViconFrame(number, self._period, self._latency_s, rows), now_ns)
        return is_whole

    def _segments_of(self, blocks: list[bytes]) -> dict[int, bytes]:
        """Each subject's root; one that cannot be read is lost, not the others."""
        segments = {}
        for data in blocks:
            try:
                identifier, segment = packets.root_of(data, self._roots)
            except ValueError as error:
                self._rejected += 1
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
        return ViconSession(self._receive, self._frames.name, self._feed, now_ns), b""

    def _receive(self, frame: ViconFrame, now_ns: int) -> None:
        seq = self._frames.number(frame.number)
        if seq is None or len(frame.rows) != len(self._frames.bodies):  # its connection has not named its subjects yet
            return
        t_capture_ns = self._capture_ns(frame, now_ns)
        placed = from_matrices(frame.rows, by_columns=False, unit_m=self._feed.unit_m, lost_is_nan=False)
        self._feed.frame(seq, t_capture_ns, self._frames.bodies, *placed)

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
        self._frames.note_exposed(t_capture_ns, now_ns)
        return t_capture_ns

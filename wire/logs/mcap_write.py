"""The flight recorder: messages to an MCAP file, from a thread of its own or in line.

In flight a thread cuts a chunk every 20 ms (every 200 ms while nobody is armed) and hands it to the operating system:
kill -9 costs no more than that, and the control loop pays only for packing the message. The lockstep host writes in
line, in larger chunks. Messages come with monotonic stamps; the file's own are dates (`formation.clock_pair`).

The message records are packed here, one `struct` each, because the lockstep host writes thousands a second;
the rare records are the `mcap` library's. The library's writer keeps the index of every chunk in memory, 200 MB an
hour at our chunks' rate; here it waits in a second file. https://mcap.dev/spec
"""

import struct
import threading
import zlib
from collections import defaultdict, deque
from collections.abc import Callable, Iterable, Iterator, Mapping
from datetime import UTC, datetime
from io import FileIO, RawIOBase
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any

import zstandard
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Channel,
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)
from mcap.writer import MCAP0_MAGIC

from formation import topics
from formation.clock_pair import SIMULATED, ClockPair
from formation.messages import PhaseChange
from formation.topics import Drop, Topic
from wire.clock import Clock
from wire.files import finish_log, new_log, private
from wire.logs.mcap_read import START_MONOTONIC, START_UNIX, lab_of
from wire.logs.views import CALM, Views
from wire.process.system import lower_priority
from wire.schema import schema_of

_MESSAGE = struct.Struct("<BQHIQQ")
_MESSAGE_INDEX = struct.Struct("<BQHI")
_FOOTER_START = struct.Struct("<BQQQ")


Stored = tuple[int, int, bytes]
"""One message on its way to a chunk: its channel, its stamp (ns) and its finished record."""


def message_record(channel: int, sequence: int, t_ns: int, data: bytes) -> Stored:
    """A message ready for `McapFile.write_chunk`; ValueError unless 0 <= t_ns < 2**64."""
    try:
        head = _MESSAGE.pack(Opcode.MESSAGE, _MESSAGE.size - 9 + len(data), channel, sequence & 0xFFFFFFFF, t_ns, t_ns)
    except struct.error as error:
        raise ValueError(f"t_ns {t_ns} does not fit a log") from error
    return channel, t_ns, head + data


class McapFile:
    """Writes the records of one file in order; every call leaves all it was given with the operating system.

    `stream` and `index` are unbuffered. `index` is an empty file to write and read: it holds the chunks' part of the
    summary until `finish`. Any write may raise OSError; the file so far stays readable.
    """

    def __init__(self, stream: RawIOBase, index: RawIOBase, library: str) -> None:
        self._stream, self._index = stream, index
        self._position = 0
        self.head = b""
        """The file up to its first chunk: with any chunk behind it, a log to be read."""
        self._crc = 0
        self._compress = zstandard.ZstdCompressor(level=3).compress
        self._schemas: list[Schema] = []
        self._channels: list[Channel] = []
        self._chunks = 0
        self._start_ns, self._end_ns = 0, 0
        self._metadata: list[MetadataIndex] = []
        self._counts: dict[int, int] = {}
        self._write(MCAP0_MAGIC + _record(Header(profile="", library=library)))

    def add_metadata(self, name: str, values: Mapping[str, str]) -> None:
        """Write a metadata record."""
        data = _record(Metadata(name=name, metadata=dict(values)))
        self._metadata.append(MetadataIndex(offset=self._position, length=len(data), name=name))
        self._write(data)

    def add_channel(self, topic: str, schema_name: str, descriptor_set: bytes) -> int:
        """Write a channel of a Protobuf schema, and that before its first; its number. Before the first chunk, so that
        damage to one chunk never costs another its meaning."""
        number = len(self._channels) + 1
        schema = next((s for s in self._schemas if (s.name, s.data) == (schema_name, descriptor_set)), None)
        if schema is None:
            schema = Schema(id=len(self._schemas) + 1, name=schema_name, encoding="protobuf", data=descriptor_set)
            self._schemas.append(schema)
            self._write(_record(schema))
        channel = Channel(id=number, topic=topic, message_encoding="protobuf", metadata={}, schema_id=schema.id)
        self._channels.append(channel)
        self._write(_record(channel))
        return number

    def write_chunk(self, messages: list[Stored]) -> bytes:
        """Write the messages as one compressed chunk and its index, and return the chunk; nothing if there are none."""
        if not messages:
            return b""
        raw = b"".join([record for _, _, record in messages])
        stamps = [t_ns for _, t_ns, _ in messages]
        chunk = Chunk(
            compression="zstd",
            data=self._compress(raw),
            message_start_time=min(stamps),
            message_end_time=max(stamps),
            uncompressed_crc=zlib.crc32(raw),
            uncompressed_size=len(raw),
        )
        record = _record(chunk)
        entries = _entries(messages)
        index, offsets = _message_indexes(entries, self._position + len(record))
        chunk_index = ChunkIndex(
            chunk_start_offset=self._position,
            chunk_length=len(record),
            message_start_time=chunk.message_start_time,
            message_end_time=chunk.message_end_time,
            message_index_offsets=offsets,
            message_index_length=len(index),
            compression=chunk.compression,
            compressed_size=len(chunk.data),
            uncompressed_size=len(raw),
        )
        _write_all(self._index, _record(chunk_index))
        self._start_ns = min(self._start_ns, chunk.message_start_time) if self._chunks else chunk.message_start_time
        self._end_ns = max(self._end_ns, chunk.message_end_time)
        self._chunks += 1
        for channel, flat in entries.items():
            self._counts[channel] = self._counts.get(channel, 0) + len(flat) // 2
        self._write(record + index)
        return record

    def finish(self) -> None:
        """Write the summary and the end of the file."""
        self._write(_record(DataEnd(data_section_crc=self._crc)))
        start, offsets, crc = self._position, b"", 0
        groups: list[tuple[Opcode, Iterable[bytes]]] = [
            (Opcode.SCHEMA, map(_record, self._schemas)),
            (Opcode.CHANNEL, map(_record, self._channels)),
            (Opcode.STATISTICS, [_record(self._statistics())]),
            (Opcode.CHUNK_INDEX, _blocks(self._index)),
            (Opcode.METADATA_INDEX, map(_record, self._metadata)),
        ]
        for opcode, parts in groups:
            at = self._position
            for part in parts:
                crc = zlib.crc32(part, crc)
                self._write(part)
            if self._position > at:
                offset = SummaryOffset(group_opcode=opcode, group_start=at, group_length=self._position - at)
                offsets += _record(offset)
        crc = zlib.crc32(offsets + _FOOTER_START.pack(Opcode.FOOTER, 20, start, self._position), crc)
        footer = Footer(summary_start=start, summary_offset_start=self._position, summary_crc=crc)
        self._write(offsets + _record(footer) + MCAP0_MAGIC)

    def _statistics(self) -> Statistics:
        return Statistics(
            attachment_count=0,
            channel_count=len(self._channels),
            channel_message_counts=self._counts,
            chunk_count=self._chunks,
            message_count=sum(self._counts.values()),
            metadata_count=len(self._metadata),
            message_start_time=self._start_ns,
            message_end_time=self._end_ns,
            schema_count=len(self._schemas),
        )

    def _write(self, data: bytes) -> None:
        _write_all(self._stream, data)
        self._crc = zlib.crc32(data, self._crc)
        if not self._chunks:
            self.head += data
        self._position += len(data)


def _write_all(stream: RawIOBase, data: bytes) -> None:
    view = memoryview(data)
    while view:  # an unbuffered write may take less than all
        view = view[stream.write(view) or 0 :]


def _blocks(file: RawIOBase) -> Iterator[bytes]:
    """What the file holds, from its beginning, a MiB at a time."""
    file.seek(0)
    while block := file.read(1 << 20):
        yield block


def _record(record: McapRecord) -> bytes:
    builder = RecordBuilder()
    record.write(builder)
    data: bytes = builder.end()  # type: ignore[no-untyped-call]
    return data


def _entries(messages: list[Stored]) -> dict[int, list[int]]:
    """Stamp and place in the chunk of each channel's messages, flat."""
    entries: defaultdict[int, list[int]] = defaultdict(list)
    at = 0
    for channel, t_ns, record in messages:
        entries[channel] += t_ns, at
        at += len(record)
    return entries


def _message_indexes(entries: Mapping[int, list[int]], position: int) -> tuple[bytes, dict[int, int]]:
    """The MessageIndex records of a chunk (to be written at `position`), and where each channel's is."""
    index = b""
    offsets: dict[int, int] = {}
    for channel, flat in entries.items():
        offsets[channel] = position + len(index)
        size = 8 * len(flat)
        index += _MESSAGE_INDEX.pack(Opcode.MESSAGE_INDEX, 6 + size, channel, size)
        index += struct.pack(f"<{len(flat)}Q", *flat)
    return index, offsets


Share = Callable[[bytes, bytes], None]
"""(the file up to its first chunk, one chunk): together they are a log."""
_LIBRARY = "mavlink-formation"
_CHUNK_MESSAGES = 1000
_BEHIND_NS = 500_000_000
_PENDING_MESSAGES = 100_000  # some fifty seconds of a stalled disk


class LogWriter:
    """Records one run. `write` is called from one thread, never blocks on the disk and never raises for it.

    A disk that fails or cannot keep up shows in `failure` and `lost`: what `formation.topics` says may be lost is
    dropped, the rest is kept. `close` writes the summary, without which a log is still readable.
    """

    def __init__(
        self,
        path: Path,
        metadata: Mapping[str, str],
        *,
        start: ClockPair = SIMULATED,
        threaded: bool = True,
        share: Share | None = None,
        overwrite: bool = False,
    ) -> None:  # fmt: skip
        """Create the file (OSError), its owner's alone, with the metadata record "run" first.

        `path` names it once it is closed and whole, until then `wire.files.partial`; both with the next free number
        where one is taken, unless overwrite. start: which date the stamps begin at; simulated time's own unless said.
        `threaded=False` writes in line. share: called with each chunk that was written, where it was written: in the
        log's own thread.
        """
        self._whole, self.path = new_log(path, overwrite)
        """`path`: where it is now."""
        self._overwrite = overwrite
        self._stream = FileIO(self.path, "w", opener=private)
        self.failure: OSError | None = None
        self.lost = 0
        self._sequence = 0
        self._pending: deque[Stored] = deque()
        self._writing_ns: int | None = None  # the stamp of the oldest message of the chunk being written
        self._share = share
        self._ahead_ns = start.ahead_ns
        self._index = TemporaryFile(dir=path.parent, buffering=0)  # noqa: SIM115 (`close` closes it)
        self._file = McapFile(self._stream, self._index, _LIBRARY)
        self._file.add_metadata("run", {**metadata, **_dated(start)})
        self._channels = {topic.name: self._open(topic) for topic in topics.ALL}
        self._views = Views(lab_of(metadata), self._file.add_channel)
        self._calm = False
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._run, name="log", daemon=True) if threaded else None
        if self._thread is not None:
            self._thread.start()

    def __enter__(self) -> "LogWriter":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def write(self, topic: Topic, message: object, t_ns: int) -> None:
        """Record `message` at `t_ns` (log time, >= 0). The topic is one of `formation.topics.ALL` (KeyError)."""
        channel, encode = self._channels[topic.name]
        if t_ns < 0:
            raise ValueError(f"t_ns {t_ns} does not fit a log")
        if len(self._pending) > _PENDING_MESSAGES and topic.drop is not Drop.NEVER:
            self.lost += 1
            return
        if isinstance(message, PhaseChange):
            self._calm = message.phase in CALM
        unix_ns = t_ns + self._ahead_ns
        self._append(channel, unix_ns, encode(message))
        for number, data in self._views.of(topic, message, t_ns, unix_ns):
            self._append(number, unix_ns, data)
        if self._thread is None and len(self._pending) >= _CHUNK_MESSAGES:
            self._drain()

    def trouble(self, now_ns: int) -> str:
        """What keeps the log from being written in time, in words that stay the same while it lasts; else empty.

        now_ns: on the clock of the messages' stamps.
        """
        if self.failure is not None:
            return f"nothing more is recorded in {self.path.name}: {self.failure.strerror or self.failure}"
        since_ns = self._writing_ns
        if since_ns is not None and now_ns + self._ahead_ns - since_ns > _BEHIND_NS:
            return f"the disk under {self.path.name} is too slow, the log is more than half a second behind"
        return ""

    def close(self) -> None:
        """Write what is pending and the summary; raises the OSError that stopped the recording, if one did."""
        if self._stream.closed:
            return
        self._closing.set()
        if self._thread is not None:
            self._thread.join()
        self._drain()
        try:
            if self.failure is None:
                self._file.add_metadata("end", {"lost": str(self.lost)})
                self._file.finish()
        finally:
            self._stream.close()
            self._index.close()
        if self.failure is not None:
            raise self.failure
        self.path = finish_log(self.path, self._whole, self._overwrite)

    def _open(self, topic: Topic) -> tuple[int, Callable[[Any], bytes]]:
        schema = schema_of(topic.type)
        return self._file.add_channel(topic.name, schema.name, schema.descriptor_set), schema.encode

    def _append(self, channel: int, unix_ns: int, data: bytes) -> None:
        self._pending.append(message_record(channel, self._sequence, unix_ns, data))
        self._sequence += 1

    def _run(self) -> None:
        lower_priority()  # it has a queue, and compresses; what it records for may not wait
        while not self._closing.wait(0.2 if self._calm else 0.02):
            self._drain()

    def _drain(self) -> None:
        """Write what is pending now as one chunk. A disk that failed once is left alone."""
        # Only popleft and append touch the queue from two threads, and both are atomic.
        self._writing_ns = self._pending[0][1] if self._pending else None
        chunk = [self._pending.popleft() for _ in range(len(self._pending))]
        if self.failure is not None:
            self.lost += len(chunk)
            return
        try:
            written = self._file.write_chunk(chunk)
            if self._share is not None and written:
                self._share(self._file.head, written)
        except OSError as error:
            self.failure = error
            self.lost += len(chunk)
        self._writing_ns = None


def _dated(start: ClockPair) -> dict[str, str]:
    """The date that the stamps begin at, as the run's metadata say it."""
    date = datetime.fromtimestamp(start.unix_ns // 1_000_000_000, UTC)
    return {
        "date": f"{date:%Y-%m-%dT%H:%M:%SZ}",
        START_MONOTONIC: str(start.monotonic_ns),
        START_UNIX: str(start.unix_ns),
    }


async def record_dates(log: LogWriter, clock: Clock) -> None:
    """Record a pair of both clocks at once, and one a minute; for ever."""
    while True:
        pair = clock.pair()
        log.write(topics.CLOCK, pair, pair.monotonic_ns)
        await clock.sleep_until_ns(pair.monotonic_ns + 60_000_000_000)

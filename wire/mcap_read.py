"""Logs read back: whole, truncated or damaged MCAP files, in file order, with a plain account of what is missing.

Every chunk stands alone behind a checksum. What does not check is skipped and told, never guessed at.
"""

import mmap
import struct
import zlib
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import Any

import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import EndOfFile
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, DataEnd, Footer, Metadata, Schema
from mcap.writer import MCAP0_MAGIC

from formation import topics
from formation.topics import Topic
from wire.schema import SchemaError, schema_of

_HEAD = struct.Struct("<BQ")
_MESSAGE = struct.Struct("<HIQQ")
_FOOTER_START = struct.Struct("<BQQQ")
_FOOTER_SIZE = 9 + 20
# Our chunks' compression, so far behind the chunk's first byte: what a search for the next one looks for.
_ZSTD = b"\4\0\0\0zstd"
_ZSTD_OFFSET = 9 + 8 + 8 + 8 + 4
_MALFORMED = (EndOfFile, struct.error, UnicodeDecodeError)


class LogError(ValueError):
    """A file that holds no log at all."""


@dataclass(frozen=True, slots=True)
class Entry:
    """One message of the log, at its log time."""

    topic: Topic
    t_ns: int
    message: Any


@dataclass(frozen=True, slots=True)
class LogCheck:
    """What a file still holds: entries by topic, first and last log time, and what is wrong with it, in words."""

    entries: Mapping[str, int]
    first_ns: int | None
    last_ns: int | None
    complete: bool
    damage: str


@dataclass(frozen=True, slots=True)
class _Messages:
    """The records inside a chunk whose checksum was right."""

    raw: bytes


_Record = Schema | Channel | Metadata | _Messages


@dataclass(slots=True)
class _Damage:
    """What was found wrong so far."""

    notes: list[str] = field(default_factory=list)
    finished: bool = False
    sequence: int = 0
    missing: int = 0

    def text(self) -> str:
        """One line; empty for a sound file."""
        shown = self.notes[:5] + ([f"and {len(self.notes) - 5} more"] if len(self.notes) > 5 else [])
        return "; ".join(shown)


@dataclass(frozen=True, slots=True)
class Log:
    """A log file: the metadata of its run, and its entries. A damaged file gives what is left of it."""

    path: Path
    metadata: Mapping[str, str]

    @property
    def entries(self) -> Iterator[Entry]:
        """The entries in file order, from the start, each time it is asked for."""
        return _entries(self.path, _Damage())


def read_log(path: Path) -> Log:
    """Open a log. Raises OSError, and LogError if the file is no MCAP file."""
    metadata: dict[str, str] = {}
    for record in _records(path, _Damage()):
        if isinstance(record, Metadata):
            metadata = record.metadata
        if isinstance(record, Metadata | _Messages):
            break
    return Log(path, metadata)


def check_log(path: Path) -> LogCheck:
    """Read a whole log and say what it holds. Raises as `read_log`."""
    damage = _Damage()
    counts: Counter[str] = Counter()
    first_ns: int | None = None
    last_ns: int | None = None
    for entry in _entries(path, damage):
        counts[entry.topic.name] += 1
        first_ns = entry.t_ns if first_ns is None else min(first_ns, entry.t_ns)
        last_ns = entry.t_ns if last_ns is None else max(last_ns, entry.t_ns)
    if damage.missing:
        damage.notes.append(f"{damage.missing} messages are missing")
    if not damage.finished:
        damage.notes.append("the file was not closed: it has no summary")
    return LogCheck(dict(counts), first_ns, last_ns, complete=not damage.notes, damage=damage.text())


def _entries(path: Path, damage: _Damage) -> Iterator[Entry]:
    """The entries of our own topics; channels of others (Foxglove's views) are passed over."""
    schemas: dict[int, Schema] = {}
    readers: dict[int, _Reader | None] = {}
    for record in _records(path, damage):
        if isinstance(record, Metadata) and (lost := record.metadata.get("lost", "0")) != "0":
            damage.notes.append(f"{lost} messages were dropped while recording")
        elif isinstance(record, Schema):
            schemas.setdefault(record.id, record)
        elif isinstance(record, Channel):
            if record.id not in readers:
                readers[record.id] = _reader(record, schemas, damage)
        elif isinstance(record, _Messages):
            for channel, t_ns, data in _messages(record, damage):
                if channel not in readers:
                    damage.notes.append(f"messages of channel {channel}, which the file does not describe")
                    readers[channel] = None
                reader = readers[channel]
                if reader is None:
                    continue
                try:
                    yield Entry(reader.topic, t_ns, reader.decode(data))
                except SchemaError as error:
                    damage.notes.append(f"{reader.topic.name} at {t_ns}: {error}")


@dataclass(frozen=True, slots=True)
class _Reader:
    topic: Topic
    decode: Callable[[bytes], Any]


_TOPICS = {topic.name: topic for topic in topics.ALL}


def _reader(channel: Channel, schemas: Mapping[int, Schema], damage: _Damage) -> _Reader | None:
    topic = _TOPICS.get(channel.topic)
    if topic is None:
        return None
    schema = schema_of(topic.type)
    written = schemas.get(channel.schema_id)
    if written is None or written.data == schema.descriptor_set:
        return _Reader(topic, schema.decode)
    try:
        return _Reader(topic, schema.decoder(written.data))
    except SchemaError as error:
        damage.notes.append(str(error))
        return None


def _messages(chunk: _Messages, damage: _Damage) -> Iterator[tuple[int, int, bytes]]:
    """(channel, log time, data) of each message of a chunk."""
    raw = chunk.raw
    at = 0
    while at + _HEAD.size <= len(raw):
        opcode, length = _HEAD.unpack_from(raw, at)
        at += _HEAD.size
        if opcode == Opcode.MESSAGE and _MESSAGE.size <= length <= len(raw) - at:
            channel, sequence, t_ns, _ = _MESSAGE.unpack_from(raw, at)
            damage.missing += (sequence - damage.sequence) & 0xFFFFFFFF
            damage.sequence = sequence + 1
            yield channel, t_ns, raw[at + _MESSAGE.size : at + length]
        at += length


def _records(path: Path, damage: _Damage) -> Iterator[_Record]:
    """The records that matter, in file order; those of a sound summary first, as they repeat what may be damaged."""
    with path.open("rb") as file:
        if file.seek(0, 2) == 0:
            raise LogError(f"{path}: empty")
        with mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
            if data[:8] != MCAP0_MAGIC and _next_chunk(data, 0, len(data)) is None:
                raise LogError(f"{path}: not an MCAP file")
            yield from _summary(data)
            yield from _scan(data, damage)


def _summary(data: mmap.mmap) -> Iterator[Schema | Channel]:
    """Schemas and channels of the summary section, if it is there and its checksum is right."""
    footer_at = len(data) - len(MCAP0_MAGIC) - _FOOTER_SIZE
    if footer_at < 0 or data[-8:] != MCAP0_MAGIC or data[footer_at] != Opcode.FOOTER:
        return
    footer = Footer.read(ReadDataStream(BytesIO(data[footer_at + 9 : footer_at + _FOOTER_SIZE])))
    start = footer.summary_start
    if not 0 < start <= footer_at:
        return
    if footer.summary_crc != zlib.crc32(data[start : footer_at + _FOOTER_SIZE - 4]):
        return
    for _, opcode, body in _walk(data, start, footer_at):
        if opcode == Opcode.SCHEMA:
            yield Schema.read(ReadDataStream(BytesIO(body)))
        elif opcode == Opcode.CHANNEL:
            yield Channel.read(ReadDataStream(BytesIO(body)))


def _walk(data: mmap.mmap, at: int, end: int) -> Iterator[tuple[int, int, bytes]]:
    """(position, opcode, body) of the records from `at`, as long as they fit before `end`."""
    while at + _HEAD.size <= end:
        opcode, length = _HEAD.unpack_from(data, at)
        stop = at + _HEAD.size + length
        if stop > end:
            return
        yield at, opcode, data[at + _HEAD.size : stop]
        at = stop


def _scan(data: mmap.mmap, damage: _Damage) -> Iterator[_Record]:
    """The data section's records, skipping from damage to the next sound chunk."""
    at = len(MCAP0_MAGIC)
    if data[:at] != MCAP0_MAGIC:
        damage.notes.append("the file does not start as an MCAP file")
    end = len(data)
    while at < end:
        reached = at
        sound = True
        for position, opcode, body in _walk(data, at, end):
            record = _parse(opcode, body)
            stop = position + _HEAD.size + len(body)
            # A record that swallows a sound chunk is none: its length is damaged.
            if record is None or _next_chunk(data, position + 1, stop) is not None:
                sound = False
                break
            reached = stop
            if isinstance(record, DataEnd):
                if not damage.notes and record.data_section_crc not in (0, _crc(data, position)):
                    damage.notes.append("the checksum of the whole is wrong")
                damage.finished = data[-8:] == MCAP0_MAGIC
                return
            if not isinstance(record, bytes):
                yield record
        following = _next_chunk(data, reached + 1, end)
        if following is None:
            lost = end - reached
            if lost:
                damage.notes.append(f"the last {lost} bytes cannot be read" if sound else f"{lost} bytes damaged")
            return
        damage.notes.append(f"bytes {reached} to {following} cannot be read")
        at = following


def _crc(data: mmap.mmap, end: int) -> int:
    with memoryview(data) as whole, whole[:end] as part:
        return zlib.crc32(part)


def _parse(opcode: int, body: bytes) -> _Record | DataEnd | bytes | None:
    """The record, its bytes where it does not matter here, None if it is damaged."""
    stream = ReadDataStream(BytesIO(body))
    record: _Record | DataEnd
    try:
        if opcode == Opcode.CHUNK:
            chunk = Chunk.read(stream)
            return _uncompressed(chunk) if stream.count == len(body) else None
        if opcode == Opcode.SCHEMA:
            record = Schema.read(stream)
        elif opcode == Opcode.CHANNEL:
            record = Channel.read(stream)
        elif opcode == Opcode.METADATA:
            record = Metadata.read(stream)
        elif opcode == Opcode.DATA_END:
            record = DataEnd.read(stream)
        else:
            return body if Opcode.HEADER <= opcode <= Opcode.SUMMARY_OFFSET else None
    except _MALFORMED:
        return None
    return record


def _uncompressed(chunk: Chunk) -> _Messages | None:
    """The chunk's records, None unless they have the checksum they should."""
    raw = chunk.data
    if chunk.compression == "zstd":
        try:
            raw = zstandard.ZstdDecompressor().decompress(chunk.data, max_output_size=chunk.uncompressed_size)
        except (zstandard.ZstdError, MemoryError):
            return None
    if len(raw) != chunk.uncompressed_size or (chunk.uncompressed_crc and zlib.crc32(raw) != chunk.uncompressed_crc):
        return None
    return _Messages(raw)


def _next_chunk(data: mmap.mmap, start: int, end: int) -> int | None:
    """Position of the next sound chunk between `start` and `end`."""
    at = start + _ZSTD_OFFSET
    while (at := data.find(_ZSTD, at, end)) >= 0:
        position = at - _ZSTD_OFFSET
        first = next(_walk(data, position, len(data)), None)
        if first is not None and first[1] == Opcode.CHUNK and isinstance(_parse(first[1], first[2]), _Messages):
            return position
        at += 1
    return None

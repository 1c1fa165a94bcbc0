"""The sound records of an MCAP file that may be truncated or damaged, and what was found wrong.

Every chunk stands alone behind a checksum. What does not check is skipped and told, never guessed at.
"""

import mmap
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path

import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import EndOfFile
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, DataEnd, Footer, Metadata, Schema
from mcap.writer import MCAP0_MAGIC

_HEAD = struct.Struct("<BQ")
_FOOTER_SIZE = 9 + 20
# Our chunks' compression, so far behind the chunk's first byte: what a search for the next one looks for.
_ZSTD = b"\4\0\0\0zstd"
_ZSTD_OFFSET = 9 + 8 + 8 + 8 + 4
_MALFORMED = (EndOfFile, struct.error, UnicodeDecodeError)


class LogError(ValueError):
    """A file that holds no log at all."""


@dataclass(frozen=True, slots=True)
class Messages:
    """The records inside a chunk whose checksum was right."""

    raw: bytes


Record = Schema | Channel | Metadata | Messages


@dataclass(slots=True)
class Damage:
    """What was found wrong so far."""

    notes: list[str] = field(default_factory=list)
    finished: bool = False
    sequence: int = 0
    missing: int = 0

    def text(self) -> str:
        """One line; empty for a sound file."""
        shown = self.notes[:5] + ([f"and {len(self.notes) - 5} more"] if len(self.notes) > 5 else [])
        return "; ".join(shown)


def scan(path: Path, damage: Damage) -> Iterator[Record]:
    """The records that matter, in file order; those of a sound summary first, as they repeat what may be damaged."""
    with path.open("rb") as file:
        if file.seek(0, 2) == 0:
            raise LogError(f"{path}: empty")
        with mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
            if data[:8] != MCAP0_MAGIC and _next_chunk(data, 0, len(data)) is None:
                raise LogError(f"{path}: not an MCAP file")
            yield from _summary(data)
            yield from _data_section(data, damage)


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
        record = _parse(opcode, body)
        if isinstance(record, Schema | Channel):
            yield record


def _walk(data: mmap.mmap, at: int, end: int) -> Iterator[tuple[int, int, bytes]]:
    """(position, opcode, body) of the records from `at`, as long as they fit before `end`."""
    while at + _HEAD.size <= end:
        opcode, length = _HEAD.unpack_from(data, at)
        stop = at + _HEAD.size + length
        if stop > end:
            return
        yield at, opcode, data[at + _HEAD.size : stop]
        at = stop


def _data_section(data: mmap.mmap, damage: Damage) -> Iterator[Record]:
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


def _parse(opcode: int, body: bytes) -> Record | DataEnd | bytes | None:
    """The record, its bytes where it does not matter here, None if it is damaged."""
    stream = ReadDataStream(BytesIO(body))
    record: Record | DataEnd
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


def _uncompressed(chunk: Chunk) -> Messages | None:
    """The chunk's records, None unless they have the checksum they should."""
    raw = chunk.data
    if chunk.compression == "zstd":
        try:
            raw = zstandard.ZstdDecompressor().decompress(chunk.data, max_output_size=chunk.uncompressed_size)
        except (zstandard.ZstdError, MemoryError):
            return None
    if len(raw) != chunk.uncompressed_size or (chunk.uncompressed_crc and zlib.crc32(raw) != chunk.uncompressed_crc):
        return None
    return Messages(raw)


def _next_chunk(data: mmap.mmap, start: int, end: int) -> int | None:
    """Position of the next sound chunk between `start` and `end`."""
    at = start + _ZSTD_OFFSET
    while (at := data.find(_ZSTD, at, end)) >= 0:
        position = at - _ZSTD_OFFSET
        first = next(_walk(data, position, len(data)), None)
        if first is not None and first[1] == Opcode.CHUNK and isinstance(_parse(first[1], first[2]), Messages):
            return position
        at += 1
    return None

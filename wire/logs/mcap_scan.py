"""The chunks of an MCAP file, whole, truncated or damaged, in file order, with a plain account of what is missing.

Every chunk stands alone behind a checksum. The scan skips and reports a chunk whose checksum is wrong; it guesses
nothing. The file's size bounds the work, whatever the file holds: each byte is searched once, each offset is checked
once, and the size of unpacked data is counted before unpacking.
"""

import mmap
import re
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path

import lz4.frame
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import EndOfFile
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, DataEnd, Footer, Metadata, Schema
from mcap.writer import MCAP0_MAGIC

from wire.text import plain

RECORD_HEAD, MESSAGE = struct.Struct("<BQ"), struct.Struct("<HIQQ")
_CHUNK, _LENGTH = struct.Struct("<QQQII"), struct.Struct("<Q")
_FOOTER_SIZE = 9 + 20
# A chunk's compression, so far behind the chunk's first byte: what a search for the next one looks for.
_PACKED = re.compile(rb"[\3\4]\0\0\0(?:zstd|lz4)")
_PACKED_OFFSET = 9 + 8 + 8 + 8 + 4
_MALFORMED = (OverflowError, EndOfFile, struct.error, UnicodeDecodeError)
CHUNK_MOST = 1 << 26
"""Bytes of one chunk unpacked."""
WORK_LEAST, WORK_A_BYTE = 1 << 26, 100
"""Bytes unpacked in all: these, and so many more for each byte of the file; our logs unpack to few times their size."""
RECORDS_LEAST, BYTES_A_RECORD = 1 << 17, 4
"""Records read in all: these, and one more for so many bytes of the file."""
_NOTES = 5
_KINDS: dict[int, type[Schema | Channel | Metadata | DataEnd]] = {
    Opcode.SCHEMA: Schema,
    Opcode.CHANNEL: Channel,
    Opcode.METADATA: Metadata,
    Opcode.DATA_END: DataEnd,
}


class LogError(ValueError):
    """A file that holds no log at all, or a message in it that is none."""


class NoFlightError(LogError):
    """A sound file without a flight: a ground's that ended before its first frame, or another program's."""


@dataclass(frozen=True, slots=True)
class Messages:
    """The records inside a chunk whose checksum was right."""

    raw: bytes


_PIECE = 1 << 20
"""Bytes whose checksum is taken at once."""
Record = Schema | Channel | Metadata | Messages


@dataclass(slots=True)
class Damage:
    """What was found wrong so far; the first faults are kept in words, all are counted."""

    notes: list[str] = field(default_factory=list)
    faults: int = 0
    finished: bool = False
    sequence: int = 0
    missing: int = 0
    records_left: int = RECORDS_LEAST

    def note(self, text: str) -> None:
        """One more fault."""
        self.faults += 1
        if len(self.notes) < _NOTES:
            self.notes.append(text)

    def text(self) -> str:
        """One line; empty for a sound file."""
        more = self.faults - len(self.notes)
        return "; ".join([*self.notes, *([f"and {more} more"] if more else [])])


def scan(path: Path, damage: Damage) -> Iterator[Record]:
    """The records that matter, in file order; those of a sound summary first, as they repeat what may be damaged."""
    with path.open("rb") as file:
        if file.seek(0, 2) == 0:
            raise LogError(f"{path}: empty")
        with mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
            scanner = _Scanner(data, damage)
            damage.records_left = RECORDS_LEAST + len(data) // BYTES_A_RECORD
            try:
                if data[:8] != MCAP0_MAGIC and scanner.next_chunk(0, len(data)) is None:
                    raise LogError(f"{path}: not an MCAP file")
                yield from _summary(data)
                yield from scanner.records()
            except _TooMuchError:
                damage.note(f"it would unpack to more than {scanner.allowed} bytes, which no log of its size holds")


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
    for at, opcode, stop in _walk(data, start, footer_at):
        if opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
            record = _parse(opcode, data[at + RECORD_HEAD.size : stop])
            if isinstance(record, Schema | Channel):
                yield record


def _walk(data: mmap.mmap | bytes, at: int, end: int) -> Iterator[tuple[int, int, int]]:
    """(position, opcode, position behind it) of the records from `at`, as long as they fit before `end`."""
    while at + RECORD_HEAD.size <= end:
        opcode, length = RECORD_HEAD.unpack_from(data, at)
        stop = at + RECORD_HEAD.size + length
        if stop > end:
            return
        yield at, opcode, stop
        at = stop


class _TooMuchError(Exception):
    """The file asks for more work than its size can be worth."""


class _Scanner:
    """One pass over one file."""

    def __init__(self, data: mmap.mmap, damage: Damage) -> None:
        self.allowed = WORK_LEAST + WORK_A_BYTE * len(data)
        self._data = data
        self._damage = damage
        self._left = self.allowed
        self._zstd = zstandard.ZstdDecompressor()
        self._searched = 0, 0
        """From where on, and up to where, no chunk can begin that ends before."""
        self._unsound: set[int] = set()
        self._last: tuple[int, Messages] | None = None

    def records(self) -> Iterator[Record]:
        """The data section's records, skipping from damage to the next sound chunk. Raises _TooMuchError."""
        data, damage = self._data, self._damage
        at = len(MCAP0_MAGIC)
        if data[:at] != MCAP0_MAGIC:
            damage.note("the file does not start as an MCAP file")
        end = len(data)
        while at < end:
            reached = at
            sound = True
            for position, opcode, stop in _walk(data, at, end):
                record = self._record(position, opcode, stop)
                if record is None:
                    sound = False
                    break
                reached = stop
                if isinstance(record, DataEnd):
                    if not damage.faults and record.data_section_crc not in (0, _crc(data, position)):
                        damage.note("the checksum of the whole is wrong")
                    damage.finished = data[-8:] == MCAP0_MAGIC
                    return
                if not isinstance(record, bytes):
                    yield record
                _release(data, position, stop)
            following = self.next_chunk(reached + 1, end)
            if following is None:
                lost = end - reached
                if lost:
                    damage.note(f"the last {lost} bytes cannot be read" if sound else f"{lost} bytes damaged")
                return
            damage.note(f"bytes {reached} to {following} cannot be read")
            at = following

    def next_chunk(self, start: int, end: int) -> int | None:
        """Position of the next sound chunk between `start` and `end`. Raises _TooMuchError."""
        for found in _PACKED.finditer(self._data, start + _PACKED_OFFSET, end):
            position = found.start() - _PACKED_OFFSET
            if self._chunk(position) is not None:
                return position
        return None

    def _is_clear(self, start: int, end: int) -> bool:
        """Whether nothing between the two looks like a chunk. Behind each chunk many small records are asked for."""
        low, high = self._searched
        if not low <= start < high:
            found = _PACKED.search(self._data, start + _PACKED_OFFSET)
            self._searched = low, high = start, found.end() if found else len(self._data) + 1
        return end < high

    def _record(self, position: int, opcode: int, stop: int) -> Record | DataEnd | bytes | None:
        """The record, its bytes where it does not matter here, None if it is damaged."""
        if opcode == Opcode.CHUNK:
            return self._chunk(position)
        # A record that swallows a sound chunk is none: its length is damaged.
        if not self._is_clear(position + 1, stop) and self.next_chunk(position + 1, stop) is not None:
            return None
        if opcode == Opcode.MESSAGE:  # as a log without chunks holds it
            return Messages(self._data[position:stop])
        return _parse(opcode, self._data[position + RECORD_HEAD.size : stop])

    def _chunk(self, position: int) -> Messages | None:
        """The records of the chunk at `position`, None if there is no sound one."""
        if self._last is not None and self._last[0] == position:
            return self._last[1]
        if position in self._unsound:
            return None
        found = self._unpack(position)
        if found is None:
            self._unsound.add(position)
        else:
            self._last = position, found
        return found

    def _unpack(self, position: int) -> Messages | None:
        data = self._data
        opcode, length = RECORD_HEAD.unpack_from(data, position)
        stop = position + RECORD_HEAD.size + length
        if opcode != Opcode.CHUNK or stop > len(data):
            return None
        self._spend(length)
        chunk = read_chunk(data[position + RECORD_HEAD.size : stop])
        if chunk is None or chunk.uncompressed_size > CHUNK_MOST:
            return None
        self._spend(chunk.uncompressed_size)
        if chunk.compression not in ("", "zstd", "lz4"):
            self._damage.note(f"chunks are packed by {plain(chunk.compression, 20)}; read are zstd, lz4 and none")
        raw = uncompressed(chunk, self._zstd)
        crc = chunk.uncompressed_crc
        if raw is None or len(raw) != chunk.uncompressed_size or (crc and zlib.crc32(raw) != crc):
            return None
        return Messages(raw)

    def _spend(self, work: int) -> None:
        self._left -= work
        if self._left < 0:
            raise _TooMuchError


def _crc(data: mmap.mmap, end: int) -> int:
    crc = 0
    for start in range(0, end, _PIECE):
        stop = min(start + _PIECE, end)
        crc = zlib.crc32(data[start:stop], crc)
        _release(data, start, stop)
    return crc


def _release(data: mmap.mmap, start: int, stop: int) -> None:
    """Keep no longer in memory what has been read of the file."""
    page = start - start % mmap.PAGESIZE
    data.madvise(mmap.MADV_DONTNEED, page, stop - page)


def _parse(opcode: int, body: bytes) -> Schema | Channel | Metadata | DataEnd | bytes | None:
    """A record that is no chunk, its bytes where it does not matter here, None if it is damaged."""
    kind = _KINDS.get(opcode)
    if kind is None:
        return body if Opcode.HEADER <= opcode <= Opcode.SUMMARY_OFFSET else None
    try:
        record: Schema | Channel | Metadata | DataEnd = kind.read(ReadDataStream(BytesIO(body)))
    except _MALFORMED:
        return None
    return record


def read_chunk(body: bytes) -> Chunk | None:
    """The chunk in a record, as the library reads it in ten times the time; None where it is none."""
    try:
        start_ns, end_ns, unpacked_size, crc, size = _CHUNK.unpack_from(body)
        at = _CHUNK.size + size
        compression = body[_CHUNK.size : at].decode()
        (length,) = _LENGTH.unpack_from(body, at)
    except (struct.error, UnicodeDecodeError):
        return None
    data = body[at + _LENGTH.size :]
    return Chunk(compression, data, end_ns, start_ns, crc, unpacked_size) if len(data) == length else None


def uncompressed(chunk: Chunk, zstd: zstandard.ZstdDecompressor) -> bytes | None:
    """The chunk's bytes, None where they are packed otherwise or not as many as they say."""
    size = chunk.uncompressed_size
    try:
        if chunk.compression == "lz4":
            unpacked: bytes = lz4.frame.LZ4FrameDecompressor().decompress(chunk.data, max_length=size)
            return unpacked
        if chunk.compression != "zstd":
            return chunk.data if not chunk.compression else None
        # zstd allocates the size in a frame's header, whatever max_output_size is: check the header first.
        if zstandard.frame_content_size(chunk.data) not in (-1, size):
            return None
        return zstd.decompress(chunk.data, max_output_size=size)
    except (zstandard.ZstdError, RuntimeError, EOFError, MemoryError):
        return None


def read_foreign(path: Path, encoding: str) -> Iterator[tuple[str, str, int, bytes]]:
    """(topic, schema's name, date in ns, data) of each message that is encoded so, in file order, of another's file.

    Raises OSError, and LogError if the file is no MCAP file.
    """
    schemas, channels = dict[int, str](), dict[int, tuple[str, str]]()
    for record in scan(path, Damage()):
        for inner in _unpacked(record.raw) if isinstance(record, Messages) else (record,):
            if isinstance(inner, Schema):
                schemas[inner.id] = inner.name
            elif isinstance(inner, Channel) and inner.message_encoding == encoding:
                channels[inner.id] = inner.topic, schemas.get(inner.schema_id, "")
            elif isinstance(inner, tuple) and inner[0] in channels:
                yield *channels[inner[0]], inner[1], inner[2]


def _unpacked(raw: bytes) -> Iterator[object]:
    """What others write into chunks: schemas, channels, and of messages the channel's number, the date and the data."""
    for at, opcode, stop in _walk(raw, 0, len(raw)):
        if opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
            yield _parse(opcode, raw[at + RECORD_HEAD.size : stop])
        elif opcode == Opcode.MESSAGE and stop - at >= RECORD_HEAD.size + MESSAGE.size:
            number, _, unix_ns, _ = MESSAGE.unpack_from(raw, at + RECORD_HEAD.size)
            yield number, unix_ns, raw[at + RECORD_HEAD.size + MESSAGE.size : stop]

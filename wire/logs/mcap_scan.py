"""The chunks of an MCAP file, whole, truncated or damaged, in file order, with a plain account of what is missing.

Every chunk stands alone behind a checksum. The scan skips and reports a chunk whose checksum is wrong; it guesses
nothing. The file's size bounds the work, whatever the file holds: what is walked, tried and unpacked is counted first.
Records are parsed by the library; its StreamReader is not used: it ends at the first damage, trusts the sizes that a
chunk claims, and reads a log in 1.5 times the time, because it reads every message index, entry by entry.
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
_CHUNK_FIXED = 8 + 8 + 8 + 4 + 4 + 8
"""Bytes of a chunk's body that are neither the name of its compression nor its data."""
_PACKED_CHUNK = re.compile(rb"\x06.{36}[\3\4]\0\0\0(?:zstd|lz4)", re.DOTALL)
_FOOTER_SIZE = 9 + 20
_MALFORMED = (OverflowError, EndOfFile, struct.error, UnicodeDecodeError)
CHUNK_MOST = 1 << 26
"""Bytes of one chunk unpacked."""
WORK_LEAST, WORK_A_BYTE = 1 << 26, 100
"""Bytes walked and unpacked in all: these, and so many more for each byte of the file; our logs unpack to few times
their size."""
RECORDS_LEAST, BYTES_A_RECORD = 1 << 17, 4
"""Records read in all: these, and one more for so many bytes of the file."""
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
        if len(self.notes) < 5:
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
                start: int | None = len(MCAP0_MAGIC)
                if data[:start] != MCAP0_MAGIC:
                    damage.note("the file does not start as an MCAP file")
                    start = scanner.next_chunk(0)
                if start is None:
                    raise LogError(f"{path}: not an MCAP file")
                yield from _summary(data)
                yield from scanner.records(start)
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
    for at, opcode, stop in walk(data, start, footer_at):
        record = _record(opcode, data[at + RECORD_HEAD.size : stop])
        if isinstance(record, Schema | Channel):
            yield record


def walk(data: mmap.mmap | bytes, at: int, end: int) -> Iterator[tuple[int, int, int]]:
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
        self._data, self._damage = data, damage
        self._left = self.allowed

    def records(self, start: int) -> Iterator[Record]:
        """The data section's records from `start`. From damage on, the next sound chunk is looked for behind the last
        one: a record whose length is damaged may have swallowed some. Raises _TooMuchError."""
        data, damage, end = self._data, self._damage, len(self._data)
        crc = zlib.crc32(data[:start])
        following: int | None = start
        while following is not None:
            reached = sound = following
            for position, opcode, stop in walk(data, following, end):
                self._spend(stop - position)
                record = self._record(position, opcode, stop)
                if record is None:
                    break
                reached = stop
                if isinstance(record, DataEnd):
                    if not damage.faults and record.data_section_crc not in (0, crc):
                        damage.note("the checksum of the whole is wrong")
                    damage.finished = data[-8:] == MCAP0_MAGIC
                    return
                crc = zlib.crc32(data[position:stop], crc)
                if isinstance(record, Messages):
                    sound = stop
                    _release(data, position, stop)
                if not isinstance(record, bytes):
                    yield record
            if reached == end:
                return
            following = self.next_chunk(sound)
            if following is None:
                damage.note(f"the last {end - reached} bytes cannot be read")
            else:
                damage.note(f"bytes {min(reached, following)} to {following} cannot be read")

    def next_chunk(self, start: int) -> int | None:
        """Position of the next sound chunk. Raises _TooMuchError."""
        while (found := _PACKED_CHUNK.search(self._data, start)) is not None:
            if self._chunk(found.start()) is not None:
                return found.start()
            start = found.start() + 1
        return None

    def _record(self, position: int, opcode: int, stop: int) -> Record | DataEnd | bytes | None:
        """The record, its bytes where it does not matter here, None if it is damaged."""
        if opcode == Opcode.CHUNK:
            return self._chunk(position)
        if opcode == Opcode.MESSAGE:  # as a log without chunks holds it
            return Messages(self._data[position:stop])
        return _record(opcode, self._data[position + RECORD_HEAD.size : stop])

    def _chunk(self, position: int) -> Messages | None:
        """The records of the chunk at `position`, None if there is no sound one."""
        data = self._data
        start, length = position + RECORD_HEAD.size, RECORD_HEAD.unpack_from(data, position)[1]
        if start + length > len(data):
            return None
        self._spend(length)
        chunk = read_chunk(data[start : start + length])
        if chunk is None:
            return None
        self._spend(chunk.uncompressed_size)
        if chunk.compression not in ("", "zstd", "lz4"):
            self._damage.note(f"chunks are packed by {plain(chunk.compression, 20)}; read are zstd, lz4 and none")
        raw = unpacked(chunk)
        return None if raw is None else Messages(raw)

    def _spend(self, work: int) -> None:
        self._left -= work
        if self._left < 0:
            raise _TooMuchError


def _release(data: mmap.mmap, start: int, stop: int) -> None:
    """Keep no longer in memory what has been read of the file."""
    page = start - start % mmap.PAGESIZE
    data.madvise(mmap.MADV_DONTNEED, page, stop - page)


def _record(opcode: int, body: bytes) -> Schema | Channel | Metadata | DataEnd | bytes | None:
    """A record that holds no messages, its bytes where it does not matter here, None if it is damaged."""
    kind = _KINDS.get(opcode)
    if kind is None:
        return body if Opcode.HEADER <= opcode <= Opcode.SUMMARY_OFFSET else None
    try:
        record: Schema | Channel | Metadata | DataEnd = kind.read(ReadDataStream(BytesIO(body)))
    except _MALFORMED:
        return None
    return record


def read_chunk(body: bytes) -> Chunk | None:
    """The chunk in a record; None where it is none, or one that says it unpacks to more than CHUNK_MOST."""
    try:
        chunk = Chunk.read(ReadDataStream(BytesIO(body)))
    except _MALFORMED:
        return None
    is_whole = _CHUNK_FIXED + len(chunk.compression.encode()) + len(chunk.data) == len(body)
    return chunk if is_whole and chunk.uncompressed_size <= CHUNK_MOST else None


def unpacked(chunk: Chunk) -> bytes | None:
    """The chunk's records; None where they are packed otherwise, not as many bytes as they say, or damaged."""
    raw, size = chunk.data, chunk.uncompressed_size
    try:
        if chunk.compression == "lz4":
            raw = lz4.frame.LZ4FrameDecompressor().decompress(raw, max_length=size)
        elif chunk.compression == "zstd":
            # zstd allocates the size in a frame's header, whatever max_output_size is: check the header first.
            if zstandard.frame_content_size(raw) not in (-1, size):
                return None
            raw = zstandard.ZstdDecompressor().decompress(raw, max_output_size=size)
        elif chunk.compression:
            return None
    except (zstandard.ZstdError, RuntimeError, EOFError, MemoryError):
        return None
    crc = chunk.uncompressed_crc
    return raw if len(raw) == size and (not crc or zlib.crc32(raw) == crc) else None


def messages(raw: bytes) -> Iterator[tuple[int, int, bytes]]:
    """(channel, date in ns, data) of each message among the records of a chunk."""
    for at, opcode, stop in walk(raw, 0, len(raw)):
        if opcode == Opcode.MESSAGE and stop - at >= RECORD_HEAD.size + MESSAGE.size:
            number, _, unix_ns, _ = MESSAGE.unpack_from(raw, at + RECORD_HEAD.size)
            yield number, unix_ns, raw[at + RECORD_HEAD.size + MESSAGE.size : stop]


def read_foreign(path: Path, encoding: str) -> Iterator[tuple[str, str, int, bytes]]:
    """(topic, schema's name, date in ns, data) of each message that is encoded so, in file order, of another's file.

    Raises OSError, and LogError if the file is no MCAP file.
    """
    schemas, channels = dict[int, str](), dict[int, tuple[str, str]]()
    for record in scan(path, Damage()):
        raw = record.raw if isinstance(record, Messages) else b""
        for described in _descriptions(raw) if raw else (record,):
            if isinstance(described, Schema):
                schemas[described.id] = described.name
            elif isinstance(described, Channel) and described.message_encoding == encoding:
                channels[described.id] = described.topic, schemas.get(described.schema_id, "")
        for number, unix_ns, data in messages(raw):
            if number in channels:
                yield *channels[number], unix_ns, data


def _descriptions(raw: bytes) -> Iterator[object]:
    """What others write into chunks before the messages: schemas and channels."""
    for at, opcode, stop in walk(raw, 0, len(raw)):
        if opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
            yield _record(opcode, raw[at + RECORD_HEAD.size : stop])

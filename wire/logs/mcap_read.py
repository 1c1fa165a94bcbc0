"""Logs read back, topic by topic as columns or message by message in the order of the file.

A file is read in one pass and in bounded memory: its chunks are unpacked and put together to blocks, whose messages
are found by one walk. Only what is asked for is decoded. What cannot be read is counted and reported.
"""

import struct
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from mcap.opcode import Opcode
from mcap.records import Channel, Metadata, Schema
from numpy.typing import NDArray

from formation import topics
from formation.clock_pair import ClockPair
from formation.maths.arrays import Bool
from formation.topics import Topic
from wire.columns import Column, Gathered, Index, joined, windows
from wire.logs.mcap_scan import Damage, LogError, Messages, NoFlightError, scan
from wire.schema import SchemaError, Written, schema_of

if TYPE_CHECKING:  # what looks at arrays alone waits for no configuration
    from formation.config import LabConfig

M = TypeVar("M")
START_MONOTONIC, START_UNIX = "start_monotonic_ns", "start_unix_ns"
"""Where a run's metadata say which date its stamps begin at; a log before version 0.2 says nothing of it."""
BLOCK = 1 << 23
"""Bytes of messages that are looked at together."""
_TOPICS = {topic.name: topic for topic in topics.ALL}
_RECORD = struct.Struct("<xQ")
_MESSAGE = np.dtype(
    [("opcode", "u1"), ("length", "<u8"), ("channel", "<u2"), ("sequence", "<u4"), ("unix_ns", "<u8"), ("sent", "<u8")]
)
_FIXED = _MESSAGE.itemsize - _RECORD.size
"""Of a message's length what is not its data."""
_BACKWARDS = 1 << 31


@dataclass(frozen=True, slots=True)
class Entry:
    """One message of a log in memory, at the monotonic time at which it was recorded."""

    topic: Topic
    t_ns: int
    message: Any


@dataclass(frozen=True, slots=True)
class Stored:
    """One message as a file holds it, decoded when it is looked at."""

    topic: Topic
    t_ns: int
    raw: bytes
    written: Written[Any]

    @property
    def message(self) -> Any:
        """The message; LogError where it is none."""
        try:
            return self.written.decode(self.raw)
        except SchemaError as error:
            raise LogError(f"{self.topic.name} at {self.t_ns}: {error}") from error

    @property
    def data(self) -> bytes:
        """As this version writes it; raises as `message`."""
        schema = schema_of(self.topic.type)
        return self.raw if self.written is schema.own else schema.encode(self.message)


@dataclass(frozen=True, slots=True)
class LogCheck:
    """What a file still holds: entries by topic, first and last log time, and what is wrong with it, in words.

    closed: whether its writer ended it, as one that is killed does not.
    """

    entries: Mapping[str, int]
    first_ns: int | None
    last_ns: int | None
    complete: bool
    damage: str
    closed: bool


@dataclass(frozen=True, slots=True, eq=False)
class TopicColumns:
    """The messages (T,) of one topic. t_ns (T,): when each was recorded; number (T,): its place among all messages."""

    t_ns: Index
    number: Index
    fields: Mapping[str, Column]

    def where(self, chosen: Bool) -> "TopicColumns":
        """Some of them; chosen (T,)."""
        if chosen.all():
            return self
        fields = {name: column.where(chosen) for name, column in self.fields.items()}
        return TopicColumns(self.t_ns[chosen], self.number[chosen], fields)

    def messages(self, kind: type[M]) -> list[M]:
        """The messages themselves; all their fields must be there, and none an array."""
        return [kind(*row) for row in zip(*(column.values.tolist() for column in self.fields.values()), strict=True)]


@dataclass(frozen=True, slots=True, eq=False)
class LogColumns:
    """What was asked of a log: by topic those that hold anything. begin_ns: when its first message was recorded; held:
    the topics of ours that it has messages of."""

    metadata: Mapping[str, str]
    begin_ns: int
    held: frozenset[Topic]
    topics: Mapping[Topic, TopicColumns]
    check: LogCheck


@dataclass(frozen=True, slots=True)
class Log:
    """A log file: the metadata of its run, and its entries. A damaged file gives what is left of it."""

    path: Path
    metadata: Mapping[str, str]

    @property
    def entries(self) -> Iterator[Stored]:
        """The entries in file order, from the start, each time it is asked for."""
        return self.only(*topics.ALL)

    def only(self, *wanted: Topic) -> Iterator[Stored]:
        """The entries of these topics, in file order."""
        return _entries(self.path, Damage(), wanted)

    @property
    def left_out(self) -> Mapping[str, frozenset[str]]:
        """By topic, the names of the fields that the version which wrote the log did not record."""
        reading = _Reading(self.path, Damage())
        next(reading.blocks(), None)
        readers = [reader for reader in reading.readers.values() if reader is not None]
        return {reader.topic.name: reader.written.left_out for reader in readers}


def read_log(path: Path) -> Log:
    """Open a log. Raises OSError, and LogError if the file is no MCAP file."""
    metadata: dict[str, str] = {}
    for record in scan(path, Damage()):
        if isinstance(record, Metadata):
            metadata = record.metadata
        if isinstance(record, Metadata | Messages):
            break
    return Log(path, metadata)


def holds_nothing(path: Path, damage: str = "") -> LogError:
    """The error of a file in which no message of a flight is found: nothing read is no result."""
    kind = LogError if damage else NoFlightError
    return kind(f"{path}: no message of a flight in it" + (f": {damage}" if damage else ""))


def read_columns(path: Path, wanted: Mapping[Topic, Collection[str]]) -> LogColumns:
    """Read a log, whole or damaged, in one pass. wanted: by topic the names of the fields; of those topics all messages
    are checked, and no other topic is counted.

    Raises OSError, and LogError if the file is no MCAP file.
    """
    damage = Damage()
    reading, parts = _Reading(path, damage), dict[Topic, list[TopicColumns]]()
    begin_ns, number, held = 0, 0, set[Topic]()
    for block in reading.blocks():
        begin_ns = begin_ns if number else int(block.t_ns[0])
        held |= {reading.of(topics.ALL)[channel].topic for channel in np.unique(block.channels).tolist()}
        for topic, names in wanted.items():
            part = _gathered(block, reading.of((topic,)), names, damage, number)
            if len(part.t_ns):
                _append(parts.setdefault(topic, []), part)
        number += len(block.t_ns)
    found = {topic: _end_to_end(parts.pop(topic)) for topic in list(parts)}
    return LogColumns(reading.metadata, begin_ns, frozenset(held), found, _check(found, damage))


def _append(parts: list[TopicColumns], part: TopicColumns) -> None:
    """Add a part; as long as the last is no shorter than the one before, they become one: a few large ones stay."""
    parts.append(part)
    while len(parts) > 1 and len(parts[-1].t_ns) >= len(parts[-2].t_ns):
        parts[-2:] = [_end_to_end(parts[-2:])]


def _end_to_end(parts: Sequence[TopicColumns]) -> TopicColumns:
    return TopicColumns(
        np.concatenate([part.t_ns for part in parts]),
        np.concatenate([part.number for part in parts]),
        {name: joined([part.fields[name] for part in parts]) for name in parts[0].fields},
    )


def _check(found: Mapping[Topic, TopicColumns], damage: Damage) -> LogCheck:
    if damage.missing > 0:
        damage.note(f"{damage.missing} messages are missing")
    if not damage.finished:
        damage.note("the file was not closed: it has no summary")
    first_ns = min((int(of_one.t_ns.min()) for of_one in found.values()), default=None)
    last_ns = max((int(of_one.t_ns.max()) for of_one in found.values()), default=None)
    counts = {topic.name: len(of_one.t_ns) for topic, of_one in found.items()}
    return LogCheck(counts, first_ns, last_ns, not damage.faults, damage.text(), damage.finished)


@dataclass(frozen=True, slots=True)
class _Reader:
    topic: Topic
    written: Written[Any]


@dataclass(frozen=True, slots=True, eq=False)
class _Block:
    """The messages (M,) of our topics in a piece of a file. starts, lengths: where in `data` their own data are;
    ahead_ns: of dates to stamps."""

    data: bytes
    channels: NDArray[np.uint16]
    unix_ns: NDArray[np.uint64]
    starts: Index
    lengths: Index
    ahead_ns: int

    @property
    def t_ns(self) -> Index:
        """The stamps (M,)."""
        return self.unix_ns.astype(np.int64) - self.ahead_ns


class _Reading:
    """One pass through a file. readers: by channel, as far as it is read; None of those that are not ours."""

    def __init__(self, path: Path, damage: Damage) -> None:
        self.metadata: Mapping[str, str] = {}
        self.readers: dict[int, _Reader | None] = {}
        self._path, self._damage = path, damage
        self._schemas: dict[int, Schema] = {}
        self._made: dict[tuple[str, int], _Reader | None] = {}
        self._ahead_ns = 0

    def blocks(self) -> Iterator[_Block]:
        """Its messages, in file order."""
        damage, pieces, size = self._damage, list[bytes](), 0
        for record in scan(self._path, damage):
            if isinstance(record, Messages):
                pieces.append(record.raw)
                size += len(record.raw)
                if size < BLOCK:
                    continue
            if pieces:
                yield from self._block(pieces)
            if not damage.records_left:
                damage.note("it holds more records than any log of its size: the rest is not read")
                return
            pieces, size = [], 0
            if not isinstance(record, Messages):
                self._learn(record)
        if pieces:
            yield from self._block(pieces)

    def of(self, topics: Collection[Topic]) -> dict[int, _Reader]:
        """The channels of these topics."""
        names = {topic.name for topic in topics}
        return {number: reader for number, reader in self.readers.items() if reader and reader.topic.name in names}

    def _learn(self, record: Schema | Channel | Metadata) -> None:
        if isinstance(record, Metadata):
            if (lost := record.metadata.get("lost", "0")) != "0":
                self._damage.note(f"{lost} messages were dropped while recording")
            self._ahead_ns = clock_of(record.metadata, self._damage).ahead_ns or self._ahead_ns
            self.metadata = self.metadata or record.metadata
        elif isinstance(record, Schema):
            self._schemas.setdefault(record.id, record)
        elif record.id not in self.readers:
            key = (record.topic, record.schema_id)  # many channels may share one large schema
            if key not in self._made:
                self._made[key] = self._reader(record)
            self.readers[record.id] = self._made[key]

    def _reader(self, channel: Channel) -> _Reader | None:
        topic, written = _TOPICS.get(channel.topic), self._schemas.get(channel.schema_id)
        if topic is None:
            return None
        schema = schema_of(topic.type)
        try:
            return _Reader(topic, schema.own if written is None else schema.written(written.data))
        except SchemaError as error:
            self._damage.note(str(error))
            return None

    def _block(self, pieces: Sequence[bytes]) -> Iterator[_Block]:
        """The block of these pieces; none where they hold no message of ours."""
        starts = np.array(_walk(pieces, self._damage), np.int64)
        data = b"".join([*pieces, bytes(_MESSAGE.itemsize)])
        heads = windows(np.frombuffer(data, np.uint8), _MESSAGE.itemsize)[starts].view(_MESSAGE)
        are_messages = (heads["opcode"] == Opcode.MESSAGE) & (heads["length"] >= _FIXED)
        heads, starts = heads[are_messages], starts[are_messages]
        _count_missing(heads["sequence"], self._damage)
        for channel in np.unique(heads["channel"]).tolist():
            if channel not in self.readers:
                self._damage.note(f"messages of channel {channel}, which the file does not describe")
                self.readers[channel] = None
        ours = np.isin(heads["channel"], list(self.of(topics.ALL)))
        heads, starts = heads[ours], starts[ours]
        if len(heads):
            lengths = heads["length"].astype(np.int64) - _FIXED
            starts = starts + _MESSAGE.itemsize
            yield _Block(data, heads["channel"], heads["unix_ns"], starts, lengths, self._ahead_ns)


def _walk(pieces: Sequence[bytes], damage: Damage) -> list[int]:
    """Where in the pieces, put together, each whole record begins."""
    starts = list[int]()
    length_at, head, base = _RECORD.unpack_from, _RECORD.size, 0
    for piece in pieces:
        at, end, left = 0, len(piece), damage.records_left
        while at + head <= end and left:
            starts.append(base + at)
            at += head + length_at(piece, at)[0]
            left -= 1
        if at > end:
            starts.pop()
        damage.records_left = left
        base += end
    return starts


def _count_missing(sequences: NDArray[np.uint32], damage: Damage) -> None:
    """Count what is missing by the messages' own numbers."""
    if len(sequences) and sequences[0] == damage.sequence & 0xFFFFFFFF and (np.diff(sequences) == 1).all():
        damage.sequence = int(sequences[-1]) + 1
        return
    for sequence in sequences.tolist():
        ahead = (sequence - damage.sequence) & 0xFFFFFFFF
        if ahead < _BACKWARDS:
            damage.missing += ahead
            damage.sequence = sequence + 1
        else:  # public tools sort messages by time, or number none of them
            damage.missing -= 1


def _gathered(
    block: _Block, readers: Mapping[int, _Reader], names: Collection[str], damage: Damage, number: int
) -> TopicColumns:
    """One topic's messages of a block. readers: its channels; number: of the block's first message."""
    chosen = np.flatnonzero(np.isin(block.channels, list(readers)))
    gathered, data = Gathered(names), np.frombuffer(block.data, np.uint8)
    for channel, reader in readers.items():
        indices = np.flatnonzero(block.channels[chosen] == channel)
        index = chosen[indices]
        gathered.receive(reader.written, data, indices, block.starts[index], block.lengths[index])
    read, columns = gathered.columns()
    t_ns = block.t_ns
    for each, error in gathered.errors:
        index = chosen[each]
        damage.note(f"{readers[int(block.channels[index])].topic.name} at {t_ns[index]}: {error}")
    return TopicColumns(t_ns[chosen[read]], number + chosen[read], columns)


def _entries(path: Path, damage: Damage, wanted: Collection[Topic]) -> Iterator[Stored]:
    """The entries of the wanted ones of our topics; channels of others (Foxglove's views) are passed over."""
    reading = _Reading(path, damage)
    for block in reading.blocks():
        readers, data = reading.of(wanted), block.data
        chosen = np.isin(block.channels, list(readers))
        columns = (column[chosen].tolist() for column in (block.channels, block.unix_ns, block.starts, block.lengths))
        for channel, unix_ns, start, length in zip(*columns, strict=True):
            reader = readers[channel]
            yield Stored(reader.topic, unix_ns - block.ahead_ns, data[start : start + length], reader.written)


def lab_of(metadata: Mapping[str, str]) -> "LabConfig | None":
    """The lab that was flown; None where a run's metadata hold none that this version reads."""
    from pydantic import ValidationError

    from formation.config import LabConfig

    try:
        return LabConfig.model_validate_json(metadata.get("lab", ""))
    except ValidationError:
        return None


def clock_of(metadata: Mapping[str, str], damage: Damage | None = None) -> ClockPair:
    """The date that a run's stamps begin at; stamps without one count as dates themselves."""
    try:
        return ClockPair(int(metadata.get(START_MONOTONIC, "0")), int(metadata.get(START_UNIX, "0")))
    except ValueError:
        if damage is not None:
            damage.note("the date at which it begins cannot be read")
        return ClockPair(0, 0)

"""Logs read back: whole, truncated or damaged MCAP files, in file order, with a plain account of what is missing."""

import struct
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mcap.opcode import Opcode
from mcap.records import Channel, Metadata, Schema

from formation import topics
from formation.clock_pair import ClockPair
from formation.topics import Topic
from wire.logs.mcap_scan import Damage, LogError, Messages, scan
from wire.schema import SchemaError, schema_of

__all__ = ["Entry", "Log", "LogCheck", "LogError", "Reading", "check_log", "holds_nothing", "read_log"]

START_MONOTONIC, START_UNIX = "start_monotonic_ns", "start_unix_ns"
"""Where a run's metadata say which date its stamps begin at; a log before version 0.2 says nothing of it."""
_TOPICS = {topic.name: topic for topic in topics.ALL}
_ALL = frozenset(topics.ALL)
_HEAD = struct.Struct("<BQ")
_MESSAGE = struct.Struct("<HIQQ")
_BACKWARDS = 1 << 31


@dataclass(frozen=True, slots=True)
class Entry:
    """One message of the log, at the monotonic time at which it was recorded."""

    topic: Topic
    t_ns: int
    message: Any


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


@dataclass(frozen=True, slots=True)
class Log:
    """A log file: the metadata of its run, and its entries. A damaged file gives what is left of it."""

    path: Path
    metadata: Mapping[str, str]

    @property
    def entries(self) -> Iterator[Entry]:
        """The entries in file order, from the start, each time it is asked for."""
        return _entries(self.path, Damage())

    def only(self, *wanted: Topic) -> Iterator[Entry]:
        """The entries of these topics, in file order; the others are not decoded."""
        return _entries(self.path, Damage(), frozenset(wanted))


def read_log(path: Path) -> Log:
    """Open a log. Raises OSError, and LogError if the file is no MCAP file."""
    metadata: dict[str, str] = {}
    for record in scan(path, Damage()):
        if isinstance(record, Metadata):
            metadata = record.metadata
        if isinstance(record, Metadata | Messages):
            break
    return Log(path, metadata)


def check_log(path: Path) -> LogCheck:
    """Read a whole log and say what it holds. Raises as `read_log`."""
    reading = Reading(path)
    for _ in reading:
        pass
    return reading.check()


def holds_nothing(path: Path, damage: str = "") -> LogError:
    """The error of a file in which no message of a flight is found: nothing read is no result."""
    return LogError(f"{path}: no message of a flight in it" + (f": {damage}" if damage else ""))


class Reading:
    """One pass through a log that gives its entries and, once they are read, says what the file holds.

    Raises OSError, and LogError if the file is no MCAP file, as it is read.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._damage = Damage()
        self._counts: Counter[str] = Counter()
        self._first_ns: int | None = None
        self._last_ns: int | None = None

    def __iter__(self) -> Iterator[Entry]:
        """The entries in file order; once only."""
        for entry in _entries(self._path, self._damage):
            t_ns = entry.t_ns
            self._counts[entry.topic.name] += 1
            self._first_ns = t_ns if self._first_ns is None else min(self._first_ns, t_ns)
            self._last_ns = t_ns if self._last_ns is None else max(self._last_ns, t_ns)
            yield entry
        if self._damage.missing > 0:
            self._damage.note(f"{self._damage.missing} messages are missing")
        if not self._damage.finished:
            self._damage.note("the file was not closed: it has no summary")

    def check(self) -> LogCheck:
        """The counts, times and damage of the file, from the entries read so far."""
        damage = self._damage
        counts, complete = dict(self._counts), not damage.faults
        return LogCheck(counts, self._first_ns, self._last_ns, complete, damage.text(), damage.finished)


def _entries(path: Path, damage: Damage, wanted: frozenset[Topic] = _ALL) -> Iterator[Entry]:
    """The entries of the wanted ones of our topics; channels of others (Foxglove's views) are passed over."""
    schemas: dict[int, Schema] = {}
    readers: dict[int, _Reader | None] = {}
    made: dict[tuple[str, int], _Reader | None] = {}
    ahead_ns = 0
    for record in scan(path, damage):
        if isinstance(record, Metadata):
            if (lost := record.metadata.get("lost", "0")) != "0":
                damage.note(f"{lost} messages were dropped while recording")
            ahead_ns = clock_of(record.metadata, damage).ahead_ns or ahead_ns
        elif isinstance(record, Schema):
            schemas.setdefault(record.id, record)
        elif isinstance(record, Channel):
            if record.id not in readers:
                key = (record.topic, record.schema_id)  # many channels may share one large schema
                if key not in made:
                    made[key] = _reader(record, schemas, damage, wanted)
                readers[record.id] = made[key]
        elif isinstance(record, Messages):
            for channel, unix_ns, data in _messages(record, damage):
                t_ns = unix_ns - ahead_ns
                if channel not in readers:
                    damage.note(f"messages of channel {channel}, which the file does not describe")
                    readers[channel] = None
                reader = readers[channel]
                if reader is None:
                    continue
                try:
                    yield Entry(reader.topic, t_ns, reader.decode(data))
                except SchemaError as error:
                    damage.note(f"{reader.topic.name} at {t_ns}: {error}")
            if not damage.records_left:
                damage.note("it holds more records than any log of its size: the rest is not read")
                return


def clock_of(metadata: Mapping[str, str], damage: Damage | None = None) -> ClockPair:
    """The date that a run's stamps begin at; stamps without one count as dates themselves."""
    try:
        return ClockPair(int(metadata.get(START_MONOTONIC, "0")), int(metadata.get(START_UNIX, "0")))
    except ValueError:
        if damage is not None:
            damage.note("the date at which it begins cannot be read")
        return ClockPair(0, 0)


@dataclass(frozen=True, slots=True)
class _Reader:
    topic: Topic
    decode: Callable[[bytes], Any]


def _reader(
    channel: Channel, schemas: Mapping[int, Schema], damage: Damage, wanted: frozenset[Topic]
) -> _Reader | None:
    topic = _TOPICS.get(channel.topic)
    if topic is None or topic not in wanted:
        return None
    schema = schema_of(topic.type)
    written = schemas.get(channel.schema_id)
    if written is None or written.data == schema.descriptor_set:
        return _Reader(topic, schema.decode)
    try:
        return _Reader(topic, schema.decoder(written.data))
    except SchemaError as error:
        damage.note(str(error))
        return None


def _messages(chunk: Messages, damage: Damage) -> Iterator[tuple[int, int, bytes]]:
    """(channel, log time, data) of each message of a chunk."""
    raw = chunk.raw
    at = 0
    while at + _HEAD.size <= len(raw) and damage.records_left:
        damage.records_left -= 1
        opcode, length = _HEAD.unpack_from(raw, at)
        at += _HEAD.size
        if opcode == Opcode.MESSAGE and _MESSAGE.size <= length <= len(raw) - at:
            channel, sequence, t_ns, _ = _MESSAGE.unpack_from(raw, at)
            ahead = (sequence - damage.sequence) & 0xFFFFFFFF
            if ahead < _BACKWARDS:
                damage.missing += ahead
                damage.sequence = sequence + 1
            else:  # public tools sort messages by time, or number none of them
                damage.missing -= 1
            yield channel, t_ns, raw[at + _MESSAGE.size : at + length]
        at += length

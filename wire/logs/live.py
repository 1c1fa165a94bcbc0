"""A log on the bus while it is written: the ground shares its chunks, a viewer's process takes them.

    <lab>/gcs/<name>/log/head    the file up to its first chunk, every second
    <lab>/gcs/<name>/log/chunk   each chunk, as it is in the file

Shared only while somebody listens, at the lowest priority, and dropped rather than queued.
"""

import struct
from collections.abc import Callable, Container, Iterable, Iterator, Mapping
from dataclasses import dataclass
from io import BytesIO
from typing import Protocol, TypeVar

import zstandard
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Metadata, Schema
from mcap.stream_reader import StreamReader
from mcap.writer import MCAP0_MAGIC

from wire.logs.mcap_read import clock_of
from wire.logs.mcap_scan import RECORD_HEAD, messages, read_chunk, unpacked

T = TypeVar("T")

END = struct.pack("<BQI", Opcode.DATA_END, 4, 0) + struct.pack("<BQ20x", Opcode.FOOTER, 20) + MCAP0_MAGIC
"""What makes a log of a head."""
HEAD_EVERY = 25
"""Chunks: half a second in flight."""
QUEUED = 64
"""Chunks that wait at who listens; then the oldest are lost."""


class Bus(Protocol):
    """What of the lab's bus is needed to share a log."""

    def publish(self, key: str, payload: bytes, attachment: bytes | None = None) -> None:
        """Publish."""

    def has_subscribers(self, key: str) -> bool:
        """Whether anybody listens."""


def keys(gcs_name: str) -> tuple[str, str]:
    """The keys of a ground's log: head and chunks."""
    return f"gcs/{gcs_name}/log/head", f"gcs/{gcs_name}/log/chunk"


def sharer(bus: Bus, gcs_name: str) -> Callable[[bytes, bytes], None]:
    """What a LogWriter shares its chunks by."""
    head_key, chunk_key = keys(gcs_name)
    for key in (head_key, chunk_key):
        bus.has_subscribers(key)  # makes its publisher here, not in the log's thread
    left = 0

    def share(head: bytes, chunk: bytes) -> None:
        nonlocal left
        if not bus.has_subscribers(chunk_key):
            left = 0
            return
        if left == 0:
            bus.publish(head_key, head)
        left = (left + 1) % HEAD_EVERY
        bus.publish(chunk_key, chunk)

    return share


def _messages(chunk: bytes, channels: Container[int]) -> Iterator[tuple[int, int, bytes]]:
    """(channel, date, data) of a chunk's messages; ValueError where it is none."""
    record = read_chunk(chunk[RECORD_HEAD.size :])
    raw = None if record is None else unpacked(record)
    if raw is None:
        raise ValueError(f"{len(chunk)} bytes that are no chunk, or one that is damaged or too large")
    return ((channel, unix_ns, data) for channel, unix_ns, data in messages(raw) if channel in channels)


@dataclass(frozen=True, slots=True)
class ChannelDescription:
    """A channel of a log, with its Protobuf schema."""

    topic: str
    schema_name: str
    descriptor_set: bytes


class LiveLog:
    """A log as it comes over the bus: who listens from the middle begins with the next head. only: of these topics."""

    def __init__(self, only: Container[str] | None = None) -> None:
        self._only = only
        self.channels: Mapping[int, ChannelDescription] = {}
        self.ahead_ns = 0
        """What is added to a stamp inside a message for its date."""
        self.rejected = 0
        """Heads and chunks that could not be read."""
        self._head = b""

    def receive_head(self, head: bytes) -> bool:
        """Whether this begins another log than before."""
        if head == self._head:
            return False
        records = self._read(lambda: StreamReader(BytesIO(head + END), emit_chunks=True).records)
        schemas = {record.id: record for record in records if isinstance(record, Schema)}
        channels = {
            record.id: ChannelDescription(record.topic, schemas[record.schema_id].name, schemas[record.schema_id].data)
            for record in records
            if isinstance(record, Channel) and record.schema_id in schemas
            if self._only is None or record.topic in self._only
        }
        if not channels:
            return False
        self._head, self.channels = head, channels
        self.ahead_ns = sum(clock_of(record.metadata).ahead_ns for record in records if isinstance(record, Metadata))
        return True

    def messages(self, chunk: bytes) -> Iterator[tuple[int, int, bytes]]:
        """(channel, date in ns since 1970, data) of each message of a chunk; none before the first head."""
        if self.channels:
            yield from self._read(lambda: _messages(chunk, self.channels))

    def _read(self, read: Callable[[], Iterable[T]]) -> list[T]:
        """All that is read; nothing, and counted, where it cannot be."""
        try:
            return list(read())
        except (McapError, struct.error, ArithmeticError, LookupError, ValueError, MemoryError, zstandard.ZstdError):
            self.rejected += 1
            return []

"""The flight recorder: messages to an MCAP file, from a thread of its own or in line, and back.

In flight a thread cuts a chunk every 20 ms and hands it to the operating system: kill -9 costs no more than that,
and the control loop pays only for packing the message. The lockstep host writes in line, in larger chunks.
"""

import threading
from collections import deque
from collections.abc import Mapping
from io import FileIO
from pathlib import Path
from typing import Any

from formation import topics
from formation.topics import Drop, Topic
from wire.logs.foxglove import View, views_of
from wire.logs.mcap_file import McapFile, Stored, message_record
from wire.logs.mcap_read import Entry, Log, LogCheck, LogError, Reading, check_log, read_log
from wire.private_files import private
from wire.schema import Schema, schema_of

__all__ = ["Entry", "Log", "LogCheck", "LogError", "LogWriter", "Reading", "check_log", "read_log"]

_LIBRARY = "mavlink-formation"
_CHUNK_PERIOD_S = 0.02
_CHUNK_MESSAGES = 1000
_BEHIND_NS = 500_000_000
_PENDING_MESSAGES = 100_000  # some fifty seconds of a stalled disk


class _Channel:
    """One channel of the log and, where Foxglove has a schema for it, its views."""

    def __init__(self, number: int, schema: Schema[Any], views: list["_ViewChannel"]) -> None:
        self.number = number
        self.encode = schema.encode
        self.views = views


class _ViewChannel:
    def __init__(self, number: int, view: View) -> None:
        self.number = number
        self.view = view
        self.next_ns = 0


class LogWriter:
    """Records one run. `write` is called from one thread, never blocks on the disk and never raises for it.

    A disk that fails or cannot keep up shows in `failure` and `lost`: what `formation.topics` says may be lost is
    dropped, the rest is kept. `close` writes the summary, without which a log is still readable.
    """

    def __init__(self, path: Path, metadata: Mapping[str, str], *, threaded: bool = True) -> None:
        """Create the file (OSError), its owner's alone, with the metadata record "run" first.

        `threaded=False` writes in line.
        """
        self.path = path
        self.failure: OSError | None = None
        self.lost = 0
        self._sequence = 0
        self._pending: deque[Stored] = deque()
        self._writing_ns: int | None = None  # the stamp of the oldest message of the chunk being written
        self._stream = FileIO(path, "w", opener=private)
        self._file = McapFile(self._stream, _LIBRARY)
        self._file.add_metadata("run", metadata)
        self._channels = {topic.name: self._open(topic) for topic in topics.ALL}
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
        channel = self._channels[topic.name]
        if len(self._pending) > _PENDING_MESSAGES and topic.drop is not Drop.NEVER:
            self.lost += 1
            return
        self._put(channel.number, t_ns, channel.encode(message))
        for view in channel.views:
            if t_ns >= view.next_ns:
                view.next_ns = t_ns + view.view.spacing_ns
                self._put(view.number, t_ns, view.view.encode(message, t_ns))
        if self._thread is None and len(self._pending) >= _CHUNK_MESSAGES:
            self._drain()

    def trouble(self, now_ns: int) -> str:
        """What keeps the log from being written in time, in words that stay the same while it lasts; else empty.

        now_ns: on the clock of the messages' stamps.
        """
        if self.failure is not None:
            return f"nothing more is recorded in {self.path.name}: {self.failure.strerror or self.failure}"
        since_ns = self._writing_ns
        if since_ns is not None and now_ns - since_ns > _BEHIND_NS:
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
        if self.failure is not None:
            raise self.failure

    def _open(self, topic: Topic) -> _Channel:
        schema = schema_of(topic.type)
        number = self._file.add_channel(topic.name, schema.name, schema.descriptor_set)
        views = [
            _ViewChannel(self._file.add_channel(view.channel, view.schema_name, view.descriptor_set), view)
            for view in views_of(topic.type)
        ]
        return _Channel(number, schema, views)

    def _put(self, channel: int, t_ns: int, data: bytes) -> None:
        self._pending.append(message_record(channel, self._sequence, t_ns, data))
        self._sequence += 1

    def _run(self) -> None:
        while not self._closing.wait(_CHUNK_PERIOD_S):
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
            self._file.write_chunk(chunk)
        except OSError as error:
            self.failure = error
            self.lost += len(chunk)
        self._writing_ns = None

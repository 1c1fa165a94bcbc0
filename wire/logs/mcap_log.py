"""The flight recorder: messages to an MCAP file, from a thread of its own or in line, and back.

In flight a thread cuts a chunk every 20 ms (every 200 ms while nobody is armed) and hands it to the operating system:
kill -9 costs no more than that, and the control loop pays only for packing the message. The lockstep host writes in
line, in larger chunks. Messages come and go with monotonic stamps; the file's own are dates (`formation.clock_pair`).
"""

import threading
from collections import deque
from collections.abc import Callable, Mapping
from datetime import UTC, datetime
from io import FileIO
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any

from pydantic import ValidationError

from formation import topics
from formation.clock_pair import SIMULATED, ClockPair
from formation.config import LabConfig
from formation.messages import PhaseChange
from formation.topics import Drop, Topic
from wire.logs.mcap_file import McapFile, Stored, message_record
from wire.logs.mcap_read import (
    START_MONOTONIC,
    START_UNIX,
    Entry,
    Log,
    LogCheck,
    LogError,
    Reading,
    check_log,
    read_log,
)
from wire.logs.views import CALM, Views
from wire.private_files import private
from wire.process.priority import lower_priority
from wire.schema import schema_of

__all__ = ["Entry", "Log", "LogCheck", "LogError", "LogWriter", "Reading", "check_log", "read_log"]

Share = Callable[[bytes, bytes], None]
"""(the file up to its first chunk, one chunk): together they are a log."""
_LIBRARY = "mavlink-formation"
_CHUNK_PERIOD_S, _CALM_PERIOD_S = 0.02, 0.2
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
    ) -> None:  # fmt: skip
        """Create the file (OSError), its owner's alone, with the metadata record "run" first.

        start: which date the stamps begin at; simulated time's own unless said. `threaded=False` writes in line.
        share: called with each chunk that was written, where it was written: in the log's own thread.
        """
        self.path = path
        self.failure: OSError | None = None
        self.lost = 0
        self._sequence = 0
        self._pending: deque[Stored] = deque()
        self._writing_ns: int | None = None  # the stamp of the oldest message of the chunk being written
        self._stream = FileIO(path, "w", opener=private)
        self._share = share
        self._ahead_ns = start.ahead_ns
        self._index = TemporaryFile(dir=path.parent, buffering=0)  # noqa: SIM115 (`close` closes it)
        self._file = McapFile(self._stream, self._index, _LIBRARY)
        self._file.add_metadata("run", {**metadata, **_dated(start)})
        self._channels = {topic.name: self._open(topic) for topic in topics.ALL}
        self._views = Views(_lab(metadata), self._file.add_channel)
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

    def _open(self, topic: Topic) -> tuple[int, Callable[[Any], bytes]]:
        schema = schema_of(topic.type)
        return self._file.add_channel(topic.name, schema.name, schema.descriptor_set), schema.encode

    def _append(self, channel: int, unix_ns: int, data: bytes) -> None:
        self._pending.append(message_record(channel, self._sequence, unix_ns, data))
        self._sequence += 1

    def _run(self) -> None:
        lower_priority()  # it has a queue, and compresses; what it records for may not wait
        while not self._closing.wait(_CALM_PERIOD_S if self._calm else _CHUNK_PERIOD_S):
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


def _lab(metadata: Mapping[str, str]) -> LabConfig | None:
    """The lab that is flown; None where the metadata hold none."""
    try:
        return LabConfig.model_validate_json(metadata.get("lab", ""))
    except ValidationError:
        return None

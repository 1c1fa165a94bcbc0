"""A recording as a source: a leader's poses in a CSV file, or the frames of an earlier flight's log."""

import asyncio
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from formation import topics
from formation.config import LabConfig
from formation.messages import LabFrame, RawFrame, Severity
from mocap.sources.csv_file import MocapFileError, read_recording
from mocap.sources.source import Feed, SourceStatus
from wire.logs.mcap_read import LogError, read_log

Frame = RawFrame | LabFrame
"""A flight's log holds frames that were aligned when it was flown."""
Timed = tuple[int, Frame]
POLL_NS = 100_000_000


class Recording:
    """A file's frames in real time, once somebody listens; MocapFileError for a file that cannot be used."""

    def __init__(
        self, config: LabConfig, deliver: Callable[[Frame], None], has_listener: Callable[[], bool], feed: Feed
    ) -> None:
        path = Path(config.mocap.file or "")
        self._frames = csv_frames(path, config) if config.mocap.source == "csv" else mcap_frames(path)
        self._delay_ns = round(config.mocap.delay_s * 1e9)
        self._deliver = deliver
        self._has_listener = has_listener
        self._feed = feed
        self._status = SourceStatus(server=str(path), bodies=self._frames[0][1].bodies)

    async def run(self) -> None:
        """Each frame `delay_s` after its own time since the first, captures restamped to now; then nothing more."""
        clock = self._feed.clock
        while not self._has_listener():
            await clock.sleep_until_ns(clock.monotonic_ns() + POLL_NS)
        self._status = replace(self._status, connected=True)
        start_ns = clock.monotonic_ns()
        for t_ns, frame in self._frames:
            await clock.sleep_until_ns(start_ns + t_ns + self._delay_ns)
            self._deliver(replace(frame, t_capture_ns=start_ns + t_ns))
        self._status = replace(self._status, connected=False)
        self._feed.report(Severity.WARNING, "the recording is over")
        await asyncio.get_running_loop().create_future()

    def status(self) -> SourceStatus:
        """How far it is."""
        return self._status


def csv_frames(path: Path, config: LabConfig) -> list[Timed]:
    """The leader's recorded poses as frames in the mocap's axes, at their own stamps."""
    recorded = read_recording(path, config.leader.body, config.mocap.unit_m)
    bodies, seen = (config.leader.body,), np.ones(1, np.bool_)
    return [
        (int(t_ns), RawFrame(seq, int(t_ns), bodies, pos[None], q[None], seen))
        for seq, (t_ns, pos, q) in enumerate(
            zip(recorded.t_ns, recorded.pos_mocap_m, recorded.q_mocap_from_marker, strict=True)
        )
    ]


def mcap_frames(path: Path) -> list[Timed]:
    """The frames that a log recorded, spaced as they were received."""
    try:
        frames = [(entry.t_ns, entry.message) for entry in read_log(path).entries if entry.topic is topics.MOCAP]
    except LogError as error:
        raise MocapFileError(path, None, str(error)) from error
    except OSError as error:
        raise MocapFileError(path, None, error.strerror or "cannot be read") from error
    if not frames:
        raise MocapFileError(path, None, "no frames in this log")
    first_ns = frames[0][0]
    return [(t_ns - first_ns, frame) for t_ns, frame in frames]

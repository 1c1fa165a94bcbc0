"""Where frames come from: whoever publishes raw frames on the lab's bus, or a recording played in real time."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from formation import topics
from formation.config import LabConfig
from formation.messages import LabFrame, RawFrame
from gcs.mocap.csv_file import MocapFileError, read_recording
from wire.clock import Clock
from wire.logs.mcap_log import LogError, read_log

Frame = RawFrame | LabFrame
"""A flight's log holds frames that were aligned when it was flown."""
Deliver = Callable[[Frame], None]
Timed = tuple[int, Frame]


def recording(config: LabConfig) -> list[Timed] | None:
    """The frames of a source that is a file, each with its time since the first, ns; else None. MocapFileError."""
    path = Path(config.mocap.file or "")
    match config.mocap.source:
        case "csv":
            return csv_frames(path, config)
        case "mcap":
            return mcap_frames(path)
        case _:
            return None


async def play(frames: Sequence[Timed], delay_ns: int, deliver: Deliver, clock: Clock) -> None:
    """Deliver each frame `delay_ns` after its own time since the first, captures restamped to now."""
    start_ns = clock.monotonic_ns()
    for t_ns, frame in frames:
        await clock.sleep_until_ns(start_ns + t_ns + delay_ns)
        deliver(replace(frame, t_capture_ns=start_ns + t_ns))


def csv_frames(path: Path, config: LabConfig) -> list[Timed]:
    """The leader's recorded poses as frames in the mocap's axes, at their own stamps."""
    recorded = read_recording(path)
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

"""A small recorded flight, and the script of a process that records until it is killed."""

import sys
import time
from pathlib import Path

import numpy as np

from formation import messages as m
from formation import topics
from wire.clock import monotonic_ns
from wire.logs.mcap_read import LogCheck, read_columns
from wire.logs.mcap_write import LogWriter

METADATA = {"lab": "lab", "seed": "7"}


def frame(seq: int) -> m.LabFrame:
    pos = np.random.default_rng(seq).normal(size=(3, 3))
    return m.LabFrame(
        seq, seq * 10_000_000, ("leader", "a", "b"), pos, np.tile([1.0, 0, 0, 0], (3, 1)), np.ones(3, bool)
    )


def record(path: Path, frames: int, *, threaded: bool = False) -> list[tuple[str, int, object]]:
    """Write a flight and say what was written: (topic, t_ns, message), in order."""
    written: list[tuple[str, int, object]] = []
    with LogWriter(path, METADATA, threaded=threaded, overwrite=True) as log:

        def put(topic: topics.Topic, message: object, t_ns: int) -> None:
            log.write(topic, message, t_ns)
            written.append((topic.name, t_ns, message))

        for i in range(frames):
            t_ns = i * 10_000_000
            put(topics.MOCAP, frame(i), t_ns)
            put(topics.TICK, m.Tick(t_ns), t_ns)
            put(topics.LINK_DOWN, m.Datagram(2, bytes([i % 256]) * 50), t_ns)
            if i % 50 == 0:
                put(topics.EVENT, m.Event(m.Severity.NOTICE, "gcs", f"event {i}"), t_ns)
    return written


def record_until_killed(path: Path) -> None:
    """Log the time every millisecond, waiting in between as a loop of events does; say on stdout what was logged."""
    log = LogWriter(path, METADATA)
    next_ns = monotonic_ns()
    while True:
        now_ns = monotonic_ns()
        log.write(topics.TICK, m.Tick(now_ns), now_ns)
        sys.stdout.write(f"{now_ns}\n")
        sys.stdout.flush()
        next_ns += 1_000_000
        time.sleep(max(0, next_ns - monotonic_ns()) * 1e-9)


def check_log(path: Path) -> LogCheck:
    """Read a whole log and say what it holds."""
    return read_columns(path, dict.fromkeys(topics.ALL, ())).check


if __name__ == "__main__":
    record_until_killed(Path(sys.argv[1]))

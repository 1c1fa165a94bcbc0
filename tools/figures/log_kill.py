"""How much of the log a kill -9 costs: a writer is killed at random instants, and what its file holds is compared.

python -m tools.figures.log_kill --kills 200
"""

import argparse
import mmap
import os
import signal
import struct
import tempfile
import time
from pathlib import Path

import numpy as np

from formation import topics
from formation.messages import Datagram, Tick
from wire import clock
from wire.logs.mcap_read import read_log
from wire.logs.mcap_write import LogWriter

_STAMP = struct.Struct("<q")
DATAGRAM = bytes(range(200))


def write_for_ever(path: Path, newest: mmap.mmap) -> None:
    """What a ground with two followers records, a hundred times a second; the newest stamp is told besides."""
    log = LogWriter(path, {})
    while True:
        now_ns = clock.monotonic_ns()
        for _ in range(6):
            log.write(topics.LINK_UP, Datagram(2, DATAGRAM), now_ns)
        log.write(topics.TICK, Tick(now_ns), now_ns)
        newest[:8] = _STAMP.pack(now_ns)
        time.sleep(0.01)


def lost_s(kills: int, folder: Path, seed: int) -> np.ndarray:
    """What each kill cost: from the last record in the file to the last one that was written, s."""
    rng, out = np.random.default_rng(seed), np.zeros(kills)
    for k in range(kills):
        path, newest = folder / f"{k}.mcap", mmap.mmap(-1, 8)
        child = os.fork()
        if child == 0:
            write_for_ever(path, newest)
        time.sleep(0.25 + 0.1 * rng.random())
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)
        (written_ns,) = _STAMP.unpack(newest[:8])
        held_ns = max((entry.t_ns for entry in read_log(path).entries), default=0)
        out[k] = (written_ns - held_ns) * 1e-9
        path.unlink()
    return out


def main() -> None:
    """Kill as often as the command line asks for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kills", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        lost = lost_s(asked.kills, Path(folder), asked.seed)
    print(f"{asked.kills} kills: median {np.median(lost) * 1e3:.0f} ms, most {lost.max() * 1e3:.0f} ms lost")


if __name__ == "__main__":
    main()

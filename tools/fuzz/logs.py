"""Logs of other recorders, damaged in any way, to `gcs-log import`."""

import resource
from collections import Counter
from pathlib import Path
from tempfile import TemporaryDirectory

from rosbags.rosbag2 import CompressionMode

from analysis.imports.cli import import_files
from analysis.imports.recording import BadFileError
from tests.analysis.imports.stranger import FORMATS, neural_fly
from tests.mocap.test_rosbag import POSE, written
from tools.fuzz.draw import Draw
from tools.fuzz.flight import ignore
from wire.errors import ConfigError

MORE_KB = 300_000
"""Of memory, more than the process had before: with it an import has 500 MB, whatever a file says of itself."""


DURATION_S = 0.5


class Imports:
    """A sound log of each format, and what damage makes of it: another log, or one line that names the file."""

    def __init__(self, draw: Draw, counts: Counter[str]) -> None:
        self._draw, self._counts, self._before_kb = draw, counts, peak_kb()
        self._sound = [(f"a.{ending}", make(DURATION_S)) for ending, make in FORMATS.values()]
        with TemporaryDirectory() as folder:
            bag = written(Path(folder) / "bag", {"/bird/pose": (POSE, 0.0)}, CompressionMode.STORAGE)
            self._sound.append(("a.mcap", next(bag.glob("*.mcap")).read_bytes()))
            self._sound.append(("a.csv", neural_fly(Path(folder), DURATION_S).read_bytes()))

    def feed(self) -> None:
        name, sound = self._draw.choice(self._sound)
        head = sound[: self._draw.choice((100, 1000, 4000))]  # where a byte means most
        data = self._draw.spoiled(head, 1.0) + sound[len(head) :] if self._draw.random() < 0.6 else sound
        with TemporaryDirectory() as folder:
            path = Path(folder) / name
            path.write_bytes(self._draw.spoiled(data, 1.0 if data is sound else 0.3))
            try:
                result = import_files([path], path.with_name("flight.mcap"), None, ignore)
                self._counts["damaged" if result.damage else "imported"] += 1
            except (BadFileError, ConfigError) as error:
                if str(path) not in str(error) or "\n" in str(error):
                    raise AssertionError(f"not one line that names the file: {error}") from error
                self._counts["rejected"] += 1
        if (used_kb := peak_kb() - self._before_kb) > MORE_KB:
            raise MemoryError(f"{used_kb} kB")


def peak_kb() -> int:
    """The most memory that this process has had."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss

"""One body's recorded poses from a CSV file in ASL/EuRoC format, checked line by line.

`timestamp [ns], x, y, z, qw, qx, qy, qz`, further columns left alone; `#` starts a comment. Stamps are kept as they
are, jitter and gaps included, unless they are arrival times: then they are re-timed. Every error names file and line.
"""

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from formation.maths import frames
from formation.maths.arrays import Float
from mocap.retiming import exposures_ns

FIELDS = 8
UNIT_WITHIN = 0.01


class MocapFileError(ValueError):
    """A recording that cannot be used: "file:line: reason"."""

    def __init__(self, path: Path, line: int | None, reason: str) -> None:
        super().__init__(f"{path}: {reason}" if line is None else f"{path}:{line}: {reason}")


@dataclass(frozen=True, slots=True, eq=False)
class Recording:
    """A recorded body: stamps in ns from the first one (k,), poses in the mocap's axes (k, 3), (k, 4), unit."""

    t_ns: NDArray[np.int64]
    pos_mocap_m: Float
    q_mocap_from_marker: Float


def read_recording(path: Path) -> Recording:
    """The recording in `path`; MocapFileError if it is missing, empty, malformed, not finite or not rising."""
    stamps: list[int] = []
    poses: list[list[float]] = []
    columns = 0
    for number, line in enumerate(_lines(path), start=1):
        text = line.partition("#")[0].strip()
        if not text or (number == 1 and text[0].isalpha()):
            continue
        fields = text.split(",")
        columns = columns or len(fields)
        stamp, pose = _parse(path, number, fields, columns)
        if stamps and stamp <= stamps[-1]:
            raise MocapFileError(path, number, f"time goes back, from {stamps[-1]} to {stamp} ns")
        stamps.append(stamp)
        poses.append(pose)
    if not stamps:
        raise MocapFileError(path, None, "no poses in this file")
    table = np.array(poses)
    t_ns = exposures_ns(np.array([stamp - stamps[0] for stamp in stamps], dtype=np.int64))
    rises = np.append(True, t_ns[1:] > np.maximum.accumulate(t_ns)[:-1])
    return Recording(t_ns[rises] - t_ns[0], table[rises, :3], frames.canonical(table[rises, 3:]))


def _lines(path: Path) -> list[str]:
    try:
        return path.read_text(encoding="utf-8").splitlines()
    except OSError as error:
        raise MocapFileError(path, None, error.strerror or "cannot be read") from error
    except UnicodeDecodeError as error:
        raise MocapFileError(path, None, "not a text file") from error


def _parse(path: Path, line: int, fields: list[str], columns: int) -> tuple[int, list[float]]:
    if len(fields) < FIELDS or len(fields) != columns:
        raise MocapFileError(path, line, f"{len(fields)} fields, expected {max(columns, FIELDS)}")
    try:
        stamp, pose = int(fields[0]), [float(field) for field in fields[1:FIELDS]]
    except ValueError as error:
        raise MocapFileError(path, line, f"not a number: {error}") from error
    if not all(map(math.isfinite, pose)):
        raise MocapFileError(path, line, "a value is not finite")
    norm = math.hypot(*pose[3:])
    if abs(norm - 1.0) > UNIT_WITHIN:
        raise MocapFileError(path, line, f"the quaternion's length is {norm:.3f}, not 1")
    return stamp, pose

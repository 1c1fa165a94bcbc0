"""One body's recorded poses from a CSV file, checked line by line; its header says what its columns are.

Further columns are left alone; `#` starts a comment. Stamps are kept as they are, jitter and gaps included, unless they
are arrival times: then they are re-timed. Every error names file, line and column.
"""

import math
from dataclasses import dataclass
from decimal import Decimal
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from formation.maths import frames
from formation.maths.arrays import Float
from mocap.retiming import exposures_ns
from mocap.sources.csv_layout import Layout, MocapFileError, layout_of
from wire.files import read_text

__all__ = ["MocapFileError", "Recording", "read_recording"]

UNIT_WITHIN = 0.01
LARGEST = 1e20
MOST = 64 << 20
"""Bytes: an hour of one body at 100 Hz has half of that."""
SPACING_NS = 50_000, 2_000_000_000
"""Between frames, in the median; other stamps are in another unit than the file says."""


@dataclass(frozen=True, slots=True, eq=False)
class Recording:
    """A recorded body: stamps in ns from the first one (k,), poses in the mocap's axes (k, 3), (k, 4), unit."""

    t_ns: NDArray[np.int64]
    pos_mocap_m: Float
    q_mocap_from_marker: Float


def read_recording(path: Path, body: str = "", unit_m: float = 1.0) -> Recording:
    """The recording in `path`; MocapFileError if it is missing, empty, malformed, not finite or not rising.

    body: whose poses, where the file has several bodies. unit_m: of positions, where the file names no unit.
    """
    lines = _lines(path)
    layout = layout_of(path, lines, body)
    stamps: list[int] = []
    poses: list[list[float]] = []
    for number, line in enumerate(lines[layout.first :], start=layout.first + 1):
        if not (fields := layout.fields(line)):
            continue
        row = _parse(path, number, fields, layout)
        if row is None or (stamps and row == (stamps[-1], poses[-1])):
            continue
        stamp, pose = row
        if stamps and stamp == stamps[-1]:
            raise MocapFileError(
                path, number, f"the stamp of the row before, {stamp} ns, with another pose: remove one"
            )
        if stamps and stamp < stamps[-1]:
            raise MocapFileError(path, number, f"time goes back, from {stamps[-1]} to {stamp} ns")
        stamps.append(stamp)
        poses.append(pose)
    if not stamps:
        raise MocapFileError(path, None, "no poses in this file")
    recorded_ns = np.array([stamp - stamps[0] for stamp in stamps], dtype=np.int64)
    _check_unit(path, layout, recorded_ns)
    table = np.array(poses)
    t_ns = exposures_ns(recorded_ns)
    rises = np.append(True, t_ns[1:] > np.maximum.accumulate(t_ns)[:-1])
    pos_mocap_m = table[rises, :3] * (unit_m if layout.unit_m is None else layout.unit_m)
    return Recording(t_ns[rises] - t_ns[0], pos_mocap_m, frames.canonical(table[rises, 3:]))


def _lines(path: Path) -> list[str]:
    try:
        return read_text(path, MOST).splitlines()
    except OSError as error:
        raise MocapFileError(path, None, error.strerror or "cannot be read") from error
    except ValueError as error:
        raise MocapFileError(path, None, str(error)) from error


def _parse(path: Path, line: int, fields: list[str], layout: Layout) -> tuple[int, list[float]] | None:
    """Stamp and pose of a row; None for one without a pose: the body was not seen."""
    if len(fields) != len(layout.names):
        reason = f"{len(fields)} columns under a header of {len(layout.names)}"
        raise MocapFileError(path, line, f"{reason}: mend the row, and separate columns by ; beside decimal commas")
    wanted = [fields[at] for at in layout.columns]
    if not any(wanted[1:]):
        return None
    if not all(wanted):
        at = next(at for at in layout.columns if not fields[at])
        raise MocapFileError(path, line, f"{_column(at, layout)} is empty; leave a pose out as a whole")
    pose = [_number(path, line, fields, at, layout) for at in layout.columns]
    norm = math.hypot(*pose[4:])
    if abs(norm - 1.0) > UNIT_WITHIN:
        raise MocapFileError(path, line, f"the quaternion's length is {norm:.3f}, not 1")
    unit_ns = layout.stamp_ns if layout.stamp_ns is not None else 1e9 if "." in wanted[0] else 1
    return round(Decimal(wanted[0]) * Decimal(unit_ns)), pose[1:]


def _number(path: Path, line: int, fields: list[str], at: int, layout: Layout) -> float:
    """The number in a column, of a size that any unit leaves finite."""
    try:
        value = float(fields[at])
    except ValueError as error:
        raise MocapFileError(path, line, f'{_column(at, layout)} = "{fields[at][:20]}": not a number') from error
    if not abs(value) < LARGEST:
        raise MocapFileError(path, line, f"{_column(at, layout)} = {fields[at][:20]}: a value is not finite")
    return value


def _column(at: int, layout: Layout) -> str:
    return f"column {at + 1} ({layout.names[at]})" if at < len(layout.names) else f"column {at + 1}"


def _check_unit(path: Path, layout: Layout, t_ns: NDArray[np.int64]) -> None:
    """Raise where frames would be too close or too far apart for cameras."""
    spacing_ns = float(np.median(np.diff(t_ns))) if len(t_ns) > 1 else None
    if spacing_ns is not None and not SPACING_NS[0] <= spacing_ns <= SPACING_NS[1]:
        cure = "name their unit in the header: timestamp [s], [ms], [us] or [ns]"
        raise MocapFileError(path, layout.first + 1, f"stamps {spacing_ns / 1e9:g} s apart: {cure}")

"""One body's recorded poses, from a CSV file that is checked line by line, or from a rosbag2.

Read are EuRoC/ASL (`timestamp [ns], x, y, z, qw, qx, qy, qz`), TUM (`timestamp tx ty tz qx qy qz qw`, seconds), any
order under a header that names it, and the rigid bodies that Motive and Vicon export. Axes are the cameras' own: what
the lab file says of the live stream holds for a recording, too. Further columns are left alone; `#` starts a comment.
Stamps are kept as they are, jitter and gaps included, unless they are arrival times: then they are re-timed. Every
error names file, line and column.
"""

import math
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from formation.maths import frames
from formation.maths.arrays import Float
from formation.model import UNIT_WITHIN
from mocap.retiming import exposures_ns
from mocap.sources.rosbag import is_bag, read_bag
from wire.csv_table import LARGEST, LENGTH, TIME, UNIT_CURE, CsvError, Layout, Table
from wire.logs.mcap_scan import LogError

MocapFileError = CsvError
"""A recording that cannot be used."""
KEYS = ("x", "y", "z", "qw", "qx", "qy", "qz")
_EUROC = ("t", *KEYS)
_TUM = ("t", "x", "y", "z", "qx", "qy", "qz", "qw")
_MOTIVE, _VICON = "Format Version", ("Objects", "Segments", "Global Angle", "Model Outputs", "Trajectories")


def layout_of(table: Table, body: str) -> Layout:
    """The layout of a recording; MocapFileError where it is not known. body: chosen where it holds several."""
    head = table.fields(0) if table.lines else []
    if head[:1] == [_MOTIVE]:
        return _motive(table, body)
    if head and head[0] in _VICON:
        return _vicon(table, body)
    return table.layout(_EUROC, _EUROC if table.delimiter else _TUM)


def _motive(table: Table, body: str) -> Layout:
    """Motive's export: rows Type, Name and ID over the columns, then Rotation or Position, then X, Y, Z, W."""
    path, top = table.path, [table.fields(at) for at in range(min(12, len(table.lines)))]
    setting = dict(pairwise(top[0]))
    rows = {fields[1]: fields for fields in top[1:8] if len(fields) > 2}
    at = next((at for at, fields in enumerate(top) if fields[:1] == ["Frame"]), 0)
    if not at or "Type" not in rows or "Name" not in rows:
        raise MocapFileError(path, 1, "an export of Motive without the header rows Type, Name and Frame: export them")
    if setting.get("Rotation Type") != "Quaternion":
        raise MocapFileError(path, 1, "exported by Motive with Euler angles: export with Rotation Type Quaternion")
    parts, axes = top[at - 1], top[at]
    columns: dict[str, dict[str, int]] = {}
    for column, (kind, name, part, axis) in enumerate(zip(rows["Type"], rows["Name"], parts, axes, strict=False)):
        if kind == "Rigid Body" and part in ("Rotation", "Position"):
            columns.setdefault(name, {})[part[0] + axis] = column
    of_body = _chosen(path, at + 1, columns, body, "Motive's rigid bodies")
    wanted = ("PX", "PY", "PZ", "RW", "RX", "RY", "RZ")
    if "Time (Seconds)" not in axes or not all(key in of_body for key in wanted):
        raise MocapFileError(path, at + 1, "Time, Rotation or Position is not among the columns: export all three")
    units = {TIME: 1e9, LENGTH: table.unit(0, [setting.get("Length Units", "Meters").lower()], LENGTH)}
    found = {"t": axes.index("Time (Seconds)"), **{key: of_body[name] for key, name in zip(KEYS, wanted, strict=True)}}
    return Layout(at + 1, found, len(axes), units)


def _vicon(table: Table, body: str) -> Layout:
    """Vicon's export: kind, frames a second, names over the columns, the columns, their units."""
    path = table.path
    try:
        names, axes, named = (table.fields(row) for row in (2, 3, 4))
        rate_hz = table.number(1, table.fields(1)[0], "frames a second")
    except IndexError as error:
        raise MocapFileError(path, 2, "an export of Vicon without rate, names, columns, units: export them") from error
    if not rate_hz >= 1.0:
        raise MocapFileError(path, 2, "frames a second: 1 or more")
    columns: dict[str, dict[str, int]] = {}
    name = ""
    for column, axis in enumerate(axes):
        name = names[column].rpartition(":")[2] if column and column < len(names) and names[column] else name
        if name:
            columns.setdefault(name, {})[axis] = column
    of_body = _chosen(path, 3, columns, body, "Vicon's objects")
    wanted = ("TX", "TY", "TZ", "RW", "RX", "RY", "RZ")
    if missing := [key for key in wanted if key not in of_body]:
        reason = f'"{name}" has no {", ".join(missing)}: export objects with rotations as quaternions (RX,RY,RZ,RW)'
        raise MocapFileError(path, 4, reason)
    unit_m = table.unit(4, ["".join(named[of_body["TX"] :][:1]).lower()], LENGTH)
    found = {"t": 0, **{key: of_body[name] for key, name in zip(KEYS, wanted, strict=True)}}
    return Layout(5, found, len(axes), {TIME: 1e9 / rate_hz, LENGTH: unit_m})


def _chosen(path: Path, line: int, columns: dict[str, dict[str, int]], body: str, kind: str) -> dict[str, int]:
    """The columns of the one body, or of the body that is named."""
    if len(columns) == 1:
        return next(iter(columns.values()))
    if body in columns:
        return columns[body]
    have = ", ".join(sorted(columns)[:8]) or "none"
    raise MocapFileError(path, line, f'{kind} are {have}; the leader\'s body "{body}" is not among them')


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

    path: a CSV file, or a rosbag2. body: whose poses, where the file has several bodies. unit_m: of positions, where
    the file names no unit.
    """
    stamps, table = _of_bag(path, body) if is_bag(path) else _of_csv(path, body, unit_m)
    recorded_ns = np.array([stamp - stamps[0] for stamp in stamps], dtype=np.int64)
    t_ns = exposures_ns(recorded_ns)
    rises = np.append(True, t_ns[1:] > np.maximum.accumulate(t_ns)[:-1])
    return Recording(t_ns[rises] - t_ns[0], table[rises, :3], frames.canonical(table[rises, 3:]))


def _of_bag(path: Path, body: str) -> tuple[list[int], Float]:
    try:
        stamped = read_bag(path, body)
    except LogError as error:
        raise MocapFileError(path, None, str(error).removeprefix(f"{path}: ")) from error
    except OSError as error:
        raise MocapFileError(path, None, error.strerror or "cannot be read") from error
    table = np.array([pose for _, pose in stamped])
    norms = np.linalg.norm(table[:, 3:], axis=1)
    if not (np.abs(table) < LARGEST).all() or not (np.abs(norms - 1.0) <= UNIT_WITHIN).all():
        raise MocapFileError(path, None, "a pose that is not finite, or whose quaternion's length is not 1")
    return [stamp_ns for stamp_ns, _ in stamped], table


def _of_csv(path: Path, body: str, unit_m: float) -> tuple[list[int], Float]:
    """Stamps, ns, and poses in m (k, 7), quaternions w x y z."""
    table = Table.read(path, MOST)
    layout = layout_of(table, body)
    stamps: list[int] = []
    poses: list[list[float]] = []
    for line, stamp_ns, pose in table.rows(layout, KEYS, {LENGTH: unit_m}):
        norm = math.hypot(*pose[3:])
        if abs(norm - 1.0) > UNIT_WITHIN:
            raise CsvError(path, line, f"the quaternion's length is {norm:.3f}, not 1")
        stamps.append(stamp_ns)
        poses.append(pose)
    if not stamps:
        raise MocapFileError(path, None, "no poses in this file")
    spacing_ns = float(np.median(np.diff(stamps))) if len(stamps) > 1 else SPACING_NS[0]
    if not SPACING_NS[0] <= spacing_ns <= SPACING_NS[1]:
        raise MocapFileError(path, layout.first + 1, f"stamps {spacing_ns / 1e9:g} s apart: {UNIT_CURE}")
    return stamps, np.array(poses)

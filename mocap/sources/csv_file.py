"""One body's recorded poses, from a CSV file that is checked line by line, or from a rosbag2.

Read are EuRoC/ASL (`timestamp [ns], x, y, z, qw, qx, qy, qz`), TUM (`timestamp tx ty tz qx qy qz qw`, seconds), any
order under a header that names it, and the rigid bodies that Motive and Vicon export. Axes are the cameras' own: what
the lab file says of the live stream holds for a recording, too. Further columns are left alone; `#` starts a comment.
Stamps are kept as they are, jitter and gaps included, unless they are arrival times: then they are re-timed. Every
error names file, line and column.
"""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from decimal import Decimal
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from formation.maths import frames
from formation.maths.arrays import Float
from formation.model import UNIT_WITHIN
from mocap.retiming import exposures_ns
from mocap.sources.rosbag import is_bag, read_bag
from wire.files import read_text
from wire.logs.mcap_scan import LogError

_TIME = re.compile(r"(time_?stamp|time|stamp|t|secs?|seconds)(_(ns|us|ms|s|secs?|seconds))?")
_POSITION = re.compile(r"(?:p|t|pos|position|trans|translation|p_rs_r)?_?([xyz])(?:_(mm|cm|m))?")
_ROTATION = re.compile(r"(?:q|quat|quaternion|orientation|rotation|q_rs)_?([wxyz])")
_UNIT = re.compile(r"\s*[\[(]\s*([^\])]*?)\s*[\])]")
_STAMP_NS = {"ns": 1, "us": 10**3, "µs": 10**3, "ms": 10**6, **dict.fromkeys(("s", "sec", "secs", "seconds"), 10**9)}
_LENGTH_M = {"mm": 0.001, "cm": 0.01, "m": 1.0, "millimeters": 0.001, "centimeters": 0.01, "meters": 1.0}
_KNOWN = (
    "known are timestamp, time or t [s, ms, us, ns]; x, tx, px or pos_x [m, cm, mm], y and z alike; "
    "qw, q_w, quat_w or orientation_w, and x, y and z alike"
)
_EUROC = "timestamp,x,y,z,qw,qx,qy,qz"
_TUM = "timestamp[s] tx ty tz qx qy qz qw"
_MOTIVE, _VICON = "Format Version", ("Objects", "Segments", "Global Angle", "Model Outputs", "Trajectories")


class MocapFileError(ValueError):
    """A recording that cannot be used: "file:line: reason"."""

    def __init__(self, path: Path, line: int | None, reason: str) -> None:
        super().__init__(f"{path}: {reason}" if line is None else f"{path}:{line}: {reason}")


@dataclass(frozen=True, slots=True)
class Layout:
    """Where a row's values are, from the line with index `first` on.

    stamp_ns: of one unit of the stamp column, None where the file does not say. unit_m: of one unit of the positions,
    likewise. columns: stamp, x, y, z, qw, qx, qy, qz. delimiter: None for blanks.
    """

    first: int
    delimiter: str | None
    names: tuple[str, ...]
    columns: tuple[int, ...]
    stamp_ns: float | None
    unit_m: float | None

    def fields(self, line: str) -> list[str]:
        """The line's fields, without comment and quotes; a decimal comma beside `;` becomes a point."""
        return fields_of(line.partition("#")[0], self.delimiter)


def fields_of(text: str, delimiter: str | None) -> list[str]:
    """The fields of a line, without blanks and quotes around them."""
    fields = [field.strip(" \t\"'") for field in text.strip(" \r\n").split(delimiter)] if text.strip() else []
    return [field.replace(",", ".") for field in fields] if delimiter == ";" else fields


def layout_of(path: Path, lines: Sequence[str], body: str) -> Layout:
    """The layout of the file's lines; MocapFileError where it is not known. body: chosen where it holds several."""
    delimiter = _delimiter(lines)
    head = fields_of(lines[0], delimiter) if lines else []
    if head[:1] == [_MOTIVE]:
        return _motive(path, lines, delimiter, body)
    if head and head[0] in _VICON:
        return _vicon(path, lines, delimiter, body)
    first = next((at for at, line in enumerate(lines) if _is_row(line, delimiter)), None)
    if first is None:
        raise MocapFileError(path, None, "no poses in this file")
    at = _header_at(lines, first, delimiter)
    if at is None:
        count = len(fields_of(lines[first].partition("#")[0], delimiter))
        header = _EUROC.split(",") if delimiter else _TUM.split()
        if count < len(header):
            reason = f"{count} columns and no header; name them in a first line: {_EUROC}"
            raise MocapFileError(path, first + 1, reason)
        return _named(path, first + 1, first, delimiter, [*header, *[""] * (count - len(header))])
    return _named(path, at + 1, first, delimiter, _header(lines[at], delimiter))


def _delimiter(lines: Sequence[str]) -> str | None:
    """`;` or a tab before `,`, by the last line with text: that is data; None for blanks."""
    text = next((line for line in reversed(lines) if line.partition("#")[0].strip()), "")
    return next((mark for mark in (";", "\t", ",") if mark in text), None)


def _is_row(line: str, delimiter: str | None) -> bool:
    """Whether the line begins with a number, as no header does."""
    fields = fields_of(line.partition("#")[0], delimiter)
    return bool(fields) and re.match(r"[-+.]?\d", fields[0]) is not None


def _header_at(lines: Sequence[str], first: int, delimiter: str | None) -> int | None:
    """The index of the line that names the columns of the first row: the last text, or a comment shaped like a row."""
    before = [at for at in range(first - 1, -1, -1) if lines[at].strip()]
    texts = [at for at in before if not lines[at].lstrip().startswith("#")]
    if texts:
        return texts[0]
    count = len(fields_of(lines[first], delimiter))
    for at in before:
        names = _header(lines[at], delimiter)
        if len(names) == count or (len(names) > 1 and _TIME.fullmatch(_plain(names[0]))):
            return at
    return None


def _header(line: str, delimiter: str | None) -> list[str]:
    text = line.strip().strip("\"'").lstrip("#% ")
    return fields_of(_UNIT.sub(r"[\1]", text) if delimiter is None else text, delimiter)


def _plain(name: str) -> str:
    return re.sub(r"[^a-z0-9]+", "_", _UNIT.sub("", name).lower()).strip("_")


def _named(path: Path, line: int, first: int, delimiter: str | None, header: Sequence[str]) -> Layout:
    """The layout under a header, whatever its order; columns of other names are left alone."""
    found: dict[str, int] = {}
    units: dict[str, set[str]] = {"t": set(), "m": set()}
    for at, name in enumerate(header):
        unit = _UNIT.search(name)
        key, quantity, suffix = _meaning(_plain(name))
        if not key:
            continue
        if key in found:
            raise MocapFileError(path, line, f'columns "{header[found[key]]}" and "{name}" both give {key}: keep one')
        found[key] = at
        if quantity:
            units[quantity] |= {text for text in (suffix, unit and unit[1].lower()) if text}
    wanted = ("t", "x", "y", "z", "qw", "qx", "qy", "qz")
    if missing := [key for key in wanted if key not in found]:
        have = ", ".join(name[:20] for name in header[:12])
        raise MocapFileError(path, line, f"the header names no {', '.join(missing)}; it has {have}; {_KNOWN}")
    return Layout(
        first,
        delimiter,
        tuple(header),
        tuple(found[key] for key in wanted),
        _unit(path, line, units["t"], _STAMP_NS),
        _unit(path, line, units["m"], _LENGTH_M),
    )


def _meaning(name: str) -> tuple[str, str, str]:
    """(column, "t" or "m" where it has a unit, unit as a part of the name); empty for a column of another kind."""
    if time := _TIME.fullmatch(name):
        return "t", "t", time[3] or ("s" if time[1].startswith("sec") else "")
    if position := _POSITION.fullmatch(name):
        return position[1], "m", position[2] or ""
    rotation = _ROTATION.fullmatch(name)
    return ("q" + rotation[1] if rotation else ""), "", ""


def _unit(path: Path, line: int, named: set[str], known: dict[str, float] | dict[str, int]) -> float | None:
    if len(named) > 1 or not named <= known.keys():
        raise MocapFileError(path, line, f"units {', '.join(sorted(named))}: one of {', '.join(known)} is read")
    return known[named.pop()] if named else None


def _motive(path: Path, lines: Sequence[str], delimiter: str | None, body: str) -> Layout:
    """Motive's export: rows Type, Name and ID over the columns, then Rotation or Position, then X, Y, Z, W."""
    settings = fields_of(lines[0], delimiter)
    setting = dict(pairwise(settings))
    rows = {fields[1]: fields for line in lines[1:8] if len(fields := fields_of(line, delimiter)) > 2}
    at = next((at for at, line in enumerate(lines[:12]) if fields_of(line, delimiter)[:1] == ["Frame"]), 0)
    if not at or "Type" not in rows or "Name" not in rows:
        raise MocapFileError(path, 1, "an export of Motive without the header rows Type, Name and Frame: export them")
    if setting.get("Rotation Type") != "Quaternion":
        raise MocapFileError(path, 1, "exported by Motive with Euler angles: export with Rotation Type Quaternion")
    parts, axes = (fields_of(lines[row], delimiter) for row in (at - 1, at))
    columns: dict[str, dict[str, int]] = {}
    for column, (kind, name, part, axis) in enumerate(zip(rows["Type"], rows["Name"], parts, axes, strict=False)):
        if kind == "Rigid Body" and part in ("Rotation", "Position"):
            columns.setdefault(name, {})[part[0] + axis] = column
    at_column = _chosen(path, at + 1, columns, body, "Motive's rigid bodies")
    wanted = ("PX", "PY", "PZ", "RW", "RX", "RY", "RZ")
    if "Time (Seconds)" not in axes or not all(key in at_column for key in wanted):
        raise MocapFileError(path, at + 1, "Time, Rotation or Position is not among the columns: export all three")
    unit_m = _unit(path, 1, {setting.get("Length Units", "Meters").lower()}, _LENGTH_M)
    stamp = axes.index("Time (Seconds)")
    return Layout(at + 1, delimiter, tuple(axes), (stamp, *(at_column[key] for key in wanted)), 1e9, unit_m)


def _vicon(path: Path, lines: Sequence[str], delimiter: str | None, body: str) -> Layout:
    """Vicon's export: kind, frames a second, names over the columns, the columns, their units."""
    try:
        rate_hz = float(fields_of(lines[1], delimiter)[0])
        names, axes, units = (fields_of(lines[row], delimiter) for row in (2, 3, 4))
    except (IndexError, ValueError) as error:
        raise MocapFileError(
            path, 2, "an export of Vicon without rate, names, columns and units: export them"
        ) from error
    columns: dict[str, dict[str, int]] = {}
    name = ""
    for column, axis in enumerate(axes):
        name = names[column].rpartition(":")[2] if column and column < len(names) and names[column] else name
        if name:
            columns.setdefault(name, {})[axis] = column
    at_column = _chosen(path, 3, columns, body, "Vicon's objects")
    wanted = ("TX", "TY", "TZ", "RW", "RX", "RY", "RZ")
    if missing := [key for key in wanted if key not in at_column]:
        reason = f'"{name}" has no {", ".join(missing)}: export objects with rotations as quaternions (RX,RY,RZ,RW)'
        raise MocapFileError(path, 4, reason)
    unit_m = _unit(path, 5, {units[at_column["TX"]].lower() if at_column["TX"] < len(units) else ""}, _LENGTH_M)
    return Layout(5, delimiter, tuple(axes), (0, *(at_column[key] for key in wanted)), 1e9 / rate_hz, unit_m)


def _chosen(path: Path, line: int, columns: dict[str, dict[str, int]], body: str, kind: str) -> dict[str, int]:
    """The columns of the one body, or of the body that is named."""
    if len(columns) == 1:
        return next(iter(columns.values()))
    if body in columns:
        return columns[body]
    have = ", ".join(sorted(columns)[:8]) or "none"
    raise MocapFileError(path, line, f'{kind} are {have}; the leader\'s body "{body}" is not among them')


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
    _check_unit(path, layout, np.array(stamps, dtype=np.int64))
    table = np.array(poses)
    table[:, :3] *= unit_m if layout.unit_m is None else layout.unit_m
    return stamps, table


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

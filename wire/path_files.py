"""Files of a leader's way: CSV of t, x, y, z, yaw; Crazyswarm's polynomials; a Skybrush show.

Its content says which of them a file is. Each becomes points through which a spline is flown, from rest to rest
(formation.guidance.spline). A message shows nothing of a file's content: it may be any.
"""

import json
import posixpath
import zipfile
import zlib
from io import BytesIO
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from formation.maths.arrays import Float
from formation.trajectory_config import POINTS_MOST
from wire.csv_table import ANGLE, LARGEST, LENGTH, TIME, CsvError, Table
from wire.files import MOST, read_bytes

COLUMNS = ("t", "x", "y", "z", "yaw")
POLYNOMIAL = ("duration", *(f"{axis}^{power}" for axis in COLUMNS[1:] for power in range(8)))
STEP_S = 0.05
"""Between points of a curve; the spline through them misses a flown one by micrometres."""
WANDER_SHARE = 0.01
"""Of the altitudes that the way spans: a climb may go aside by the rounding of its file, and as the drone wanders."""
ZIPPED = b"PK\x03\x04"
Points = list[list[float]]


def read_points(path: Path) -> Points:
    """Rows of t (s, from 0), x, y, z (m), yaw (rad); ValueError names file and line."""
    try:
        data = read_bytes(path)
        points = _show(data) if data.startswith(ZIPPED) else _rows(Table.read(path, MOST))
        if len(points) > POINTS_MOST:
            raise ValueError(f"{len(points)} points, {POINTS_MOST} at most")
    except OSError as error:
        raise ValueError(f"{path}: {error.strerror}") from error
    except CsvError:
        raise
    except (ValueError, zipfile.BadZipFile) as error:
        raise ValueError(f"{path}: {error}") from error
    return points


def _rows(table: Table) -> Points:
    head = [word.lower() for word in table.fields(0)] if table.lines else []
    if tuple(head[: len(POLYNOMIAL)]) == POLYNOMIAL:
        return _polynomials([_piece(table, at) for at in range(1, len(table.lines)) if table.fields(at)])
    layout = table.layout(COLUMNS, COLUMNS, optional=("yaw",))
    keys = [key for key in COLUMNS[1:] if key in layout.columns]
    rows = table.rows(layout, keys, {TIME: 1e9, LENGTH: 1.0, ANGLE: 1.0})
    return [[stamp_ns * 1e-9, *values, *[0.0] * (4 - len(keys))] for _, stamp_ns, values in rows]


def _piece(table: Table, at: int) -> list[float]:
    fields = table.fields(at)
    if len(fields) < len(POLYNOMIAL):
        raise table.error(at, f"{len(fields)} columns, {', '.join(POLYNOMIAL)} are wanted")
    return [table.number(at, word, key) for key, word in zip(POLYNOMIAL, fields, strict=False)]


def _polynomials(pieces: Points) -> Points:
    """Pieces of the seventh order, lowest power first, each in the time since it began (uav_trajectory.py)."""
    points, begun_s = Points(), 0.0
    _require_short(sum(piece[0] for piece in pieces))
    for duration_s, *coefficients in pieces:
        u = _steps(duration_s)
        motion = np.polynomial.polynomial.polyval(u * duration_s, np.reshape(coefficients, (4, 8)).T)
        points += np.vstack((begun_s + u * duration_s, motion)).T.tolist()[min(len(points), 1) :]
        begun_s += duration_s
    return points


def _show(data: bytes) -> Points:
    """The way of the first drone of a Skybrush show (.skyc), without its take-off and landing, which are the ground's.

    Bezier curves from each point to the next, by the control points between them; it heads along x.
    """
    try:
        with zipfile.ZipFile(BytesIO(data)) as show:
            trajectory = _json(show, "show.json")["swarm"]["drones"][0]["settings"]["trajectory"]
            if "$ref" in trajectory:
                trajectory = _json(show, posixpath.normpath(trajectory["$ref"].split("#")[0]))
        keys = [(float(t_s), np.array([end, *controls], float)) for t_s, end, controls in trajectory["points"]]
        _require_short(keys[-1][0] - keys[0][0])
        if not all((np.abs(key) < LARGEST).all() for _, key in keys):
            raise ValueError("a point is not finite")
    except (
        KeyError,
        IndexError,
        TypeError,
        AttributeError,
        RuntimeError,
        EOFError,
        OverflowError,
        zlib.error,
    ) as error:
        raise ValueError("no show of Skybrush: swarm.drones[0].settings.trajectory.points is wanted") from error
    return _aloft(_curves(keys))


def _json(show: zipfile.ZipFile, name: str) -> Any:
    """The JSON document of that name; ValueError for what is none, or too long."""
    with show.open(name) as file:
        data = file.read(MOST + 1)
    if len(data) > MOST:
        raise ValueError(f"more than {MOST >> 20} MiB")
    return json.loads(data)


def _curves(keys: list[tuple[float, Float]]) -> Float:
    """Rows t, x, y, z, yaw along the curves; each key has its time, its place and the control points of its curve."""
    rows = [np.array([[keys[0][0], *keys[0][1][0, :3], 0.0]])]
    for (begin_s, begin), (end_s, end) in pairwise(keys):
        u = _steps(end_s - begin_s)[1:, None, None]
        curve = np.vstack((begin[:1], end[1:], end[:1]))[None, :, :3]
        while curve.shape[1] > 1:  # de Casteljau
            curve = (1.0 - u) * curve[:, :-1] + u * curve[:, 1:]
        t_s = begin_s + u[:, 0] * (end_s - begin_s)
        rows.append(np.hstack((t_s, curve[:, 0], np.zeros_like(t_s))))
    return np.vstack(rows)


def _aloft(rows: Float) -> Points:
    """What lies between the climb at the beginning and the descent at the end, which may wander, timed from 0."""
    first, last = _climb(rows), len(rows) - _climb(rows[::-1])
    aside_m = np.hypot(*(rows[first:last, 1:3] - rows[first, 1:3]).T)
    if not aside_m.size or aside_m.max() <= WANDER_SHARE * np.ptp(rows[:, 3]):
        raise ValueError("the first drone only goes up and down")
    rows = rows[first:last]
    rows[:, 0] -= rows[0, 0]
    return rows.tolist()  # type: ignore[no-any-return]


def _climb(rows: Float) -> int:
    """The row at which a climb ends: from there on the way goes aside more than up."""
    more_up_m = rows[:, 3] - rows[0, 3] - np.hypot(*(rows[:, 1:3] - rows[0, 1:3]).T)
    fallen_m = np.maximum.accumulate(more_up_m) - more_up_m
    over = int(np.argmax(np.append(fallen_m, np.inf) > WANDER_SHARE * np.ptp(rows[:, 3])))
    return int(np.argmax(more_up_m[: max(over, 1)]))


def _require_short(duration_s: float) -> None:
    """ValueError where it lasts too long, before it is made."""
    if not duration_s <= POINTS_MOST * STEP_S:
        raise ValueError(f"it lasts {duration_s:g} s, {POINTS_MOST * STEP_S:g} s at most")


def _steps(duration_s: float) -> Float:
    """Shares of a piece at which it is taken, 0 and 1 among them; ValueError for a duration that is none."""
    if not duration_s > 0.0:
        raise ValueError("times must rise")
    return np.linspace(0.0, 1.0, int(np.ceil(duration_s / STEP_S)) + 1)

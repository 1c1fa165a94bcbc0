"""What a reader makes of a file: tables of columns on the file's own clock. Which column is what, a map says."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from analysis.reading import STRAY_NS
from formation.maths.arrays import Float
from wire.logs.mcap_scan import LogError
from wire.text import plain

Values = NDArray[Any]
BACK_S = 1.0
"""Rows of one table may come out of order by the time a logger's queue holds them; further back is another clock."""
SHOWN = 120
"""Characters of what a parser says of a file."""


class BadFileError(LogError):
    """A file that is not what its name or beginning says; names file and where."""


@dataclass(frozen=True, slots=True, eq=False)
class Table:
    """Rows with common stamps. t_s (T,): never falling, on the file's clock; columns: numbers (T,), NaN missing."""

    t_s: Float
    columns: Mapping[str, Values]


@dataclass(frozen=True, slots=True, eq=False)
class Recording:
    """One file, read. tables: by name; the only one of a CSV has none. unix_s: date of the clock's zero, if known.

    damage: what was lost of a file that is cut short, and where; empty of a whole one. texts: (t_s, severity as
    MAVLink's, text). parameters: of the autopilot.
    """

    path: Path
    kind: str
    tables: Mapping[str, Table]
    unix_s: float | None = None
    damage: str = ""
    texts: tuple[tuple[float, int, str], ...] = ()
    parameters: Mapping[str, float] = field(default_factory=dict)

    @property
    def span_s(self) -> tuple[float, float]:
        """Its first stamp and its last."""
        stamps = [rows.t_s for rows in self.tables.values()]
        return min(float(t_s[0]) for t_s in stamps), max(float(t_s[-1]) for t_s in stamps)

    def columns(self) -> dict[str, tuple[str, str]]:
        """Every column by its whole name, `table.column`: its table, its name there."""
        return {
            f"{table}.{name}" if table else name: (table, name)
            for table, rows in self.tables.items()
            for name in rows.columns
        }


@contextmanager
def parsing(path: Path) -> Iterator[None]:
    """Turn whatever another's parser raises over a file's bytes into BadFileError."""
    try:
        yield
    except Exception as error:  # a parser of others, over anybody's bytes
        is_ours = isinstance(error, LogError | ModuleNotFoundError)
        if is_ours or (isinstance(error, OSError) and error.filename is not None):
            raise
        text = plain(f"{type(error).__name__}: {error}", SHOWN)
        raise BadFileError(f"{path}: cannot be read: {text}") from error


def table(path: Path, name: str, t_s: Float, columns: Mapping[str, Values]) -> Table | None:
    """The rows in order, none without a value; None where nothing is left.

    BadFileError, with the row, where a stamp is no number or goes back.
    """
    where = f"{path}: {name or 'its rows'}"
    if (bad := np.flatnonzero(~np.isfinite(t_s))).size:
        raise BadFileError(f"{where}, row {bad[0] + 1}: its stamp is not a number")
    back = np.flatnonzero(np.diff(t_s) < -BACK_S)
    if back.size:
        k = int(back[0]) + 1
        raise BadFileError(f"{where}, row {k + 1}: time goes back from {t_s[k - 1]:.6g} to {t_s[k]:.6g} s")
    if (np.diff(t_s) < 0.0).any():
        order = np.argsort(t_s, kind="stable")
        t_s, columns = t_s[order], {key: values[order] for key, values in columns.items()}
    floats = [values for values in columns.values() if values.dtype.kind == "f"]
    if floats and len(floats) == len(columns):
        has = np.zeros(len(t_s), np.bool_)
        for values in floats:
            has |= np.isfinite(values)
        if not has.all():
            t_s, columns = t_s[has], {key: values[has] for key, values in columns.items()}
    return Table(t_s, columns) if len(t_s) and columns else None


def demand_one_time(recording: Recording) -> None:
    """BadFileError where the stamps of a file leave a gap that no flight has."""
    stamps = [rows.t_s for rows in recording.tables.values()]
    if not stamps:
        raise BadFileError(f"{recording.path}: no row of numbers in it")
    t_s = np.sort(np.concatenate(stamps))
    if (wide := np.flatnonzero(np.diff(t_s) > STRAY_NS * 1e-9)).size:
        k = int(wide[0])
        late = next(name for name, rows in recording.tables.items() if (rows.t_s == t_s[k + 1]).any())
        where = f"{recording.path}: {late or 'its rows'}"
        raise BadFileError(f"{where}: stamps jump from {t_s[k]:.6g} to {t_s[k + 1]:.6g} s")

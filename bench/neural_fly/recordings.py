"""Neural-Fly's recorded flights: files that the user has fetched, read line by line. Never part of this project.

O'Connell, Shi et al., "Neural-Fly enables rapid learning for agile flight in strong winds", Science Robotics 7 (2022);
github aerorobotics/neural-fly, data/experiment: custom_figure8_METHOD_CONDITION.csv, 50 Hz.
"""

import csv
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

import numpy as np

from formation.maths.arrays import Float

WINDS: Mapping[str, str] = MappingProxyType(
    {"nowind": "0", "35wind": "4.2", "70wind": "8.5", "70p20sint": "8.5 + 2.4 sin t", "100wind": "12.1"}
)
"""The conditions by their names in the files, and the wind's speed, m/s, by the article."""
METHODS = ("baseline", "indi", "L1", "NF-C", "NF-T", "NF")
PUSHED_BY = "baseline"
"""Whose flight's residual force is replayed."""
SETTLED_S = 5.0
"""The article's figures are of what comes after."""
COLUMNS = {"t": (), "p": (3,), "p_d": (3,), "fa": (3,)}


class RecordingError(ValueError):
    """A file that cannot be used: "file:line column: reason"."""


@dataclass(frozen=True, slots=True, eq=False)
class Recording:
    """One flight: times (T,), s from 0; position and reference (T, 3), m; residual force (T, 3), N. Axes: z up."""

    t_s: Float
    pos_m: Float
    reference_m: Float
    residual_n: Float

    @property
    def rms_m(self) -> float:
        """Of the distance from the reference, once settled."""
        error_m = np.linalg.norm(self.pos_m - self.reference_m, axis=-1)[self.t_s > SETTLED_S]
        return float(np.sqrt(np.mean(error_m**2)))


def path_of(folder: Path, method: str, wind: str) -> Path:
    """Where a flight's file is looked for."""
    return folder / f"custom_figure8_{method}_{wind}.csv"


def read(path: Path) -> Recording:
    """The flight in a file; RecordingError where it cannot be used."""
    try:
        with path.open(encoding="utf-8", newline="") as file:
            rows = list(csv.DictReader(file))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise RecordingError(f"{path}: {getattr(error, 'strerror', None) or error}") from error
    if len(rows) < 2:
        raise RecordingError(f"{path}: {len(rows)} lines of data, at least 2 are needed")
    columns = [np.array([_cell(path, k, row, name, shape) for k, row in enumerate(rows, 2)])
               for name, shape in COLUMNS.items()]  # fmt: skip
    if (np.diff(columns[0]) <= 0.0).any():
        raise RecordingError(f"{path}: column `t` does not rise")
    return Recording(columns[0] - columns[0][0], *columns[1:])


def _cell(path: Path, line: int, row: Mapping[str, str], name: str, shape: tuple[int, ...]) -> Float:
    try:
        value = np.array(json.loads(row[name]), dtype=np.float64)
    except (KeyError, TypeError, ValueError) as error:
        raise RecordingError(f"{path}:{line} {name}: not a number or a list of numbers") from error
    if value.shape != shape or not np.isfinite(value).all():
        raise RecordingError(f"{path}:{line} {name}: not {shape[0] if shape else 1} finite number(s)")
    return value

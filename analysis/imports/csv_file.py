"""A CSV of any columns: a header, numbers, lists of numbers in brackets. Empty cells and NaN are missing values."""

import csv
import json
import re
from collections.abc import Callable, Iterator, Sequence
from itertools import islice
from pathlib import Path
from typing import Any, TextIO

import numpy as np

from analysis.imports.recording import BadFileError, Recording, Values, table
from formation.maths.arrays import Float
from wire.text import plain

KIND = "CSV"
ROWS = 10_000
"""Rows that are held as text at once."""
WIDEST = 1000
"""Numbers that a list in a cell may hold."""
DATES_S = (1e9, 1e10)
"""Stamps between these are seconds since 1970: from 2001 to 2286."""

ClockOf = Callable[[Sequence[str]], tuple[str, float]]


def read(path: Path, clock_of: ClockOf) -> Recording:
    """The file. clock_of: of the columns' names, which has the stamps, and how many seconds one of it is.

    BadFileError, with the line. A last row that is cut short is left out and reported as damage.
    """
    with path.open(newline="", encoding="utf-8-sig") as file:
        try:
            delimiter = _delimiter(file)
            rows = csv.reader(file, delimiter=delimiter, skipinitialspace=True)
            names = [name.strip().lstrip("#% ") for name in next(rows, [])]
            if len(names) < 2 or all(_is_number(name) for name in names):
                raise BadFileError(f"{path}:1: no header that names its columns, such as t,x,y,z")
            columns, damage = _columns(path, names, rows)
        except (UnicodeDecodeError, csv.Error) as error:
            raise BadFileError(f"{path}: no text of columns: {plain(str(error), 120)}") from error
    clock, scale = clock_of(list(columns))
    t_s = scale * columns.pop(clock)
    rows_read = table(path, "", t_s, columns)
    if rows_read is None:
        raise BadFileError(f"{path}: no row of numbers in it")
    is_dated = DATES_S[0] < rows_read.t_s[0] < DATES_S[1]
    return Recording(path, KIND, {"": rows_read}, unix_s=0.0 if is_dated else None, damage=damage)


def _delimiter(file: TextIO) -> str:
    line = file.readline(1 << 20)
    file.seek(0)
    return max(",;\t", key=line.count)


def _is_number(text: str) -> bool:
    return re.fullmatch(r"[-+.\deE]+", text) is not None


def _columns(path: Path, names: Sequence[str], rows: Any) -> tuple[dict[str, Float], str]:
    """The columns by name, those of lists as `name[0]`, and what is wrong with the last row. Columns of words are left
    out, those without a name or with another's are called by their number."""
    seen = [name or f"column{k}" for k, name in enumerate(names, 1)]
    keys = [name if name not in seen[:k] else f"{name}_{k + 1}" for k, name in enumerate(seen)]
    parts: dict[str, list[Float]] = {}
    widths: dict[str, int] = {}
    words: set[str] = set()
    damage, line = "", 1
    while block := list(islice(rows, ROWS)):
        lines = range(line + 1, line + 1 + len(block))
        line = lines.stop - 1
        rows_here = [(at, row) for at, row in zip(lines, block, strict=True) if any(row)]
        wrong = next((k for k, (_, row) in enumerate(rows_here) if len(row) != len(keys)), None)
        if wrong is not None:
            at, row = rows_here[wrong]
            damage = f"{path}:{at}: {len(row)} columns under a header of {len(keys)}"
            if rows_here[wrong + 1 :] or next(rows, None) is not None:
                raise BadFileError(damage)
            rows_here = rows_here[:wrong]
        for key, cells in zip(keys, zip(*(row for _, row in rows_here), strict=True), strict=False):
            if key not in words:
                values = _numbers(path, rows_here[0][0], key, cells, widths)
                words |= set() if values is not None else {key}
                parts.setdefault(key, []).extend(() if values is None else (values,))
    columns: dict[str, Float] = {}
    for key, found in parts.items():
        if key in words or not found:
            continue
        values = np.concatenate(found)
        columns |= {key: values} if values.ndim == 1 else {f"{key}[{k}]": part for k, part in enumerate(values.T)}
    return columns, damage and f"{damage}: cut short there; the rows before it are imported"


def _numbers(path: Path, line: int, key: str, cells: Sequence[str], widths: dict[str, int]) -> Float | None:
    """The numbers in cells (T,) of a column, (T,), or of lists (T, w); None of words."""
    try:
        values = np.array(cells).astype(np.float64)
    except ValueError:
        first = next((cell for cell in cells if cell.strip()), "")
        if first.startswith("["):
            values = np.stack(list(_lists(path, line, key, cells, widths)))
        elif _is_number(first.strip()) or not first:
            values = np.array([_number(path, at, key, cell) for at, cell in enumerate(cells, line)])
        else:
            return None
    return np.where(np.isfinite(values), values, np.nan)


def _number(path: Path, line: int, key: str, cell: str) -> float:
    try:
        return float(cell) if cell.strip() else np.nan
    except ValueError as error:
        raise BadFileError(f"{path}:{line} {plain(key, 40)}: {plain(cell, 20)!r} is not a number") from error


def _lists(path: Path, line: int, key: str, cells: Sequence[str], widths: dict[str, int]) -> Iterator[Values]:
    """Every cell as many numbers as the column's first."""
    for at, cell in enumerate(cells, line):
        try:
            values = np.array(json.loads(cell), np.float64).ravel()
        except (ValueError, TypeError, OverflowError, RecursionError) as error:
            raise BadFileError(f"{path}:{at} {plain(key, 40)}: not a list of numbers") from error
        if not 0 < len(values) == widths.setdefault(key, min(len(values), WIDEST)):
            raise BadFileError(f"{path}:{at} {plain(key, 40)}: {len(values)} numbers in a list of {widths[key]}")
        yield values

"""CSV as any program writes it: columns by the names of a header, in its order and units; other columns are left alone.

Separators are `,` `;` tab and blanks, decimal commas are read, `#` starts a comment. Every error names file, line and
column, and the unit in which a number was read. Of a file's content it shows numbers and known names alone: a lab file
may name any file.
"""

import csv
import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from decimal import Decimal
from pathlib import Path
from types import MappingProxyType

from wire.files import read_text
from wire.text import plain

LARGEST, LATEST_NS = 1e20, 2**62
"""Larger numbers are refused, so that any unit leaves them finite; larger stamps, so that differences have 64 bits."""
TIME, LENGTH, ANGLE, ROTATION = "ns", "m", "rad", ""
UNITS: Mapping[str, Mapping[str, float]] = MappingProxyType({
    TIME: {"ns": 1, "us": 1e3, "µs": 1e3, "ms": 1e6, "msec": 1e6, "s": 1e9, "sec": 1e9, "secs": 1e9, "seconds": 1e9},
    LENGTH: {"mm": 0.001, "millimeters": 0.001, "cm": 0.01, "centimeters": 0.01, "m": 1.0, "meters": 1.0},
    ANGLE: {"rad": 1.0, "radians": 1.0, **dict.fromkeys(("deg", "degrees", "°"), math.pi / 180.0)},
})  # fmt: skip
"""By the unit of each quantity here, what a header may call another one, and how many of ours that is."""
_NAMES = (
    (TIME, "t", r"(?:time_?stamp|time|stamp|t|secs?|seconds)(?:_(?P<unit>[num]?s|msec|secs?|seconds))?(?P<key>)"),
    (LENGTH, "", r"(?:p|t|pos|position|trans|translation|p_rs_r)?_?(?P<key>[xyz])(?:_(?P<unit>[mc]?m))?"),
    (ANGLE, "yaw", r"(?:yaw|heading)(?:_(?P<unit>rad|deg))?(?P<key>)"),
    (ROTATION, "q", r"(?:q|quat|quaternion|orientation|rotation|q_rs)_?(?P<key>[wxyz])(?P<unit>)"),
)
KNOWN = {
    "t": "timestamp, time or t [s, ms, us, ns]",
    "x": "x, tx, px or pos_x [m, cm, mm], y and z alike",
    "yaw": "yaw or heading [rad, deg]",
    "qw": "qw, q_w, quat_w or orientation_w, and x, y and z alike",
}
UNIT_CURE = "name the unit in the header: timestamp [s], [ms], [us] or [ns]"
_UNIT = re.compile(r"\s*[\[(]\s*([^\])]*?)\s*[\])]")


Row = tuple[int, int, list[float]]
"""Its line, its stamp in ns, its values."""


class CsvError(ValueError):
    """A file of numbers that cannot be used: "file:line: reason"."""

    def __init__(self, path: Path, line: int | None, reason: str) -> None:
        super().__init__(f"{path}: {reason}" if line is None else f"{path}:{line}: {reason}")


@dataclass(frozen=True, slots=True)
class Layout:
    """Where values are: the index of the first row, the columns by key (t, x, yaw, qw ...), how many a row has.

    units: how many ns, m or rad one of the file is, by quantity; without those whose unit the file does not name.
    """

    first: int
    columns: Mapping[str, int]
    count: int
    units: Mapping[str, float]


@dataclass(frozen=True, slots=True)
class Table:
    """The lines of a file, and what separates its columns; None: blanks."""

    path: Path
    lines: Sequence[str]
    delimiter: str | None

    @classmethod
    def read(cls, path: Path, most: int) -> "Table":
        """The file's table; CsvError where it is no text. most: bytes. Its last line with content is data."""
        try:
            lines = read_text(path, most).splitlines()
        except OSError as error:
            raise CsvError(path, None, error.strerror or "cannot be read") from error
        except ValueError as error:
            raise CsvError(path, None, str(error)) from error
        last = next((line for line in reversed(lines) if line.partition("#")[0].strip()), "").strip()
        marks = ";\t" if re.search(r"[\d.] +[-+.]?\d", last) else ";\t,"
        return cls(path, lines, next((mark for mark in marks if mark in last), None))

    def error(self, at: int, reason: str) -> CsvError:
        """The error of the line with index `at`."""
        return CsvError(self.path, at + 1, reason)

    def fields(self, at: int, text: str | None = None) -> list[str]:
        """The fields of the line with index `at`, or of its `text`, without comment, blanks and quotes; CsvError."""
        text = (self.lines[at].partition("#")[0] if text is None else text).strip(" \r\n")
        if '"' in text and self.delimiter is not None:
            try:
                (words,) = csv.reader([text], delimiter=self.delimiter, skipinitialspace=True, strict=True)
            except csv.Error as error:
                raise self.error(at, "a quote that is left open, or text behind one") from error
        else:
            words = text.split(self.delimiter) if text else []
        return [word.strip(" \t\"'") for word in words]

    def layout(self, wanted: Sequence[str], bare: Sequence[str], optional: Sequence[str] = ()) -> Layout:
        """Where `wanted` is, by the header, or by `bare`, the columns of a file without one; CsvError."""
        rows = (at for at in range(len(self.lines)) if re.match(r"[-+.]?\d", next(iter(self.fields(at)), "")))
        if (first := next(rows, None)) is None:
            raise CsvError(self.path, None, "no line of numbers in this file")
        count = len(self.fields(first))
        at, header = self._header_before(first, count) or (first, [*bare, *[""] * (count - len(bare))])
        if at == first and count < len(bare):
            raise self.error(at, f"{count} columns and no header; name them in a first line: {','.join(bare)}")
        found: dict[str, int] = {}
        units: dict[str, set[str]] = {}
        for column, (quantity, key, unit) in enumerate(map(_meaning, header)):
            if key in found:
                raise self.error(at, f'columns "{header[found[key]]}" and "{header[column]}" both give {key}: keep one')
            if key in wanted:
                found[key] = column
                units.setdefault(quantity, set()).update({unit} - {""} if quantity else ())
        if missing := [key for key in wanted if key not in found and key not in optional]:
            known = "; ".join(text for key, text in KNOWN.items() if key in wanted)
            raise self.error(at, f"the header names no {', '.join(missing)}; known are {known}")
        sizes = {quantity: self.unit(at, named, quantity) for quantity, named in units.items() if named}
        return Layout(first, found, len(header), sizes)

    def _header_before(self, first: int, count: int) -> tuple[int, list[str]] | None:
        """Index and names of the header: the last text before the first row, or a comment shaped like the row."""
        before = [at for at in range(first - 1, -1, -1) if self.lines[at].strip()]
        texts = [at for at in before if not self.lines[at].lstrip().startswith("#")]
        for at in texts[:1] or before:
            text = self.lines[at].strip().lstrip("#% ")
            names = self.fields(at, _UNIT.sub(r"[\1]", text) if self.delimiter is None else text)
            names = [name.lstrip("#% ") for name in names]
            if texts or len(names) == count or (len(names) > 1 and _meaning(names[0])[0] == TIME):
                return at, names
        return None

    def unit(self, at: int, named: Iterable[str], quantity: str) -> float:
        """The size of the one unit that is named; CsvError for several, and for one that is not known."""
        known, (name, *others) = UNITS[quantity], sorted(named)
        if others or name not in known:
            units = ", ".join(plain(each, 12) for each in (name, *others))
            raise self.error(at, f"units {units}: one of {', '.join(known)} is read")
        return known[name]

    def number(self, at: int, text: str, what: str) -> float:
        """The number in a field, of a size that any unit leaves finite; CsvError. what: names the field."""
        if not text:
            raise self.error(at, f"{what} is empty; leave a row's values out as a whole")
        try:
            value = float(text)
        except ValueError as error:
            raise self.error(at, f"{what} is not a number") from error
        if not abs(value) < LARGEST:
            raise self.error(at, f"{what} = {text[:20]}: a value is not finite")
        return value

    def rows(self, layout: Layout, keys: Sequence[str], units: Mapping[str, float]) -> Iterator[Row]:
        """Each row that has any of `keys`; CsvError for one that cannot be used, also where time goes back.

        units: of the quantities whose unit the file does not name; without TIME, stamps are seconds where one has a
        point, else ns. A row that repeats the one before is left out.
        """
        split = [
            (at, [field.replace(",", ".") for field in self.fields(at)]) for at in range(layout.first, len(self.lines))
        ]
        for at, fields in split:
            if fields and (len(fields) < layout.count or any(fields[layout.count :])):
                reason = f"{len(fields)} columns under a header of {layout.count}"
                raise self.error(at, f"{reason}: mend the row, and separate columns by ; beside decimal commas")
        at_t, at_keys = layout.columns["t"], [layout.columns[key] for key in keys]
        present = [(at, fields) for at, fields in split if fields and any(fields[column] for column in at_keys)]
        stamp_unit = 1e9 if any("." in fields[at_t] for _, fields in present) else 1.0
        sizes = {TIME: stamp_unit, ROTATION: 1.0, **units, **layout.units}
        scales, what = [sizes[_quantity(key)] for key in keys], [_named(key, layout, sizes) for key in ("t", *keys)]
        before: tuple[int, list[float]] | None = None
        for at, fields in present:
            self.number(at, fields[at_t], what[0])
            numbers = [self.number(at, fields[column], name) for column, name in zip(at_keys, what[1:], strict=True)]
            try:
                stamp_ns = Decimal(fields[at_t]) * Decimal(sizes[TIME])
            except ArithmeticError:  # as good as zero, and with an exponent that no Decimal has
                stamp_ns = Decimal(0)
            if not abs(stamp_ns) < LATEST_NS:
                raise self.error(at, f"{what[0]} = {fields[at_t][:24]} is no time; {UNIT_CURE}")
            row = round(stamp_ns), [scale * number for scale, number in zip(scales, numbers, strict=True)]
            if row == before:
                continue
            if before is not None and row[0] == before[0]:
                raise self.error(at, f"the stamp of the row before, {row[0]} ns, with other values: remove one")
            if before is not None and row[0] < before[0]:
                raise self.error(at, f"time goes back, from {before[0]} to {row[0]} ns")
            before = row
            yield at + 1, *row


def _named(key: str, layout: Layout, sizes: Mapping[str, float]) -> str:
    """The column of a key in words, with its unit, which is assumed where the file does not say it."""
    quantity = _quantity(key)
    unit = next((name for name, size in UNITS.get(quantity, {}).items() if size == sizes[quantity]), "")
    assumed = ", taken as " if quantity not in layout.units else ", "
    return f"column {layout.columns[key] + 1} ({key}{assumed + unit if unit else ''})"


def _quantity(key: str) -> str:
    return {"t": TIME, "x": LENGTH, "y": LENGTH, "z": LENGTH, "yaw": ANGLE}.get(key, ROTATION)


def _meaning(name: str) -> tuple[str, str, str]:
    """(quantity, key, unit) for which a name in a header stands; empty where for none of ours, or without a unit."""
    bracket, bare = _UNIT.search(name), re.sub(r"[^a-z0-9]+", "_", _UNIT.sub("", name).lower()).strip("_")
    for quantity, prefix, pattern in _NAMES:
        if found := re.fullmatch(pattern, bare):
            unit = "s" if bare.startswith("sec") else found["unit"]
            return quantity, prefix + found["key"], (bracket and bracket[1].lower()) or unit or ""
    return "", "", ""

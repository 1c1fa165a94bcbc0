"""ArduPilot's DataFlash log (.bin): indexed by pymavlink's reader, unpacked by columns."""

import contextlib
import io
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from analysis.imports.recording import Recording, Table, Values, parsing, table
from wire.text import plain

KIND = "DataFlash"
MAGIC = b"\xa3\x95\x80"
HEAD = 3
"""Bytes before a message: two of magic, one of its type."""
STAMP = "TimeUS"
ITSELF = ("FMT", "FMTU", "UNIT", "MULT")
"""Messages about the log, not the flight."""
NUMBERS = {
    "b": "i1", "B": "u1", "g": "f2", "h": "<i2", "H": "<u2", "i": "<i4", "I": "<u4", "f": "<f4", "c": "<i2", "C": "<u2",
    "e": "<i4", "E": "<u4", "L": "<i4", "d": "<f8", "M": "u1", "q": "<i8", "Q": "<u8",
}  # fmt: skip
"""Formats of one number; n, N, Z and a are texts and arrays."""
TEXTS = {"n": "V4", "N": "V16", "Z": "V64", "a": "V64"}
LONGEST_TEXT = 200
INFO = 6
"""MAVLink's severity of a text that has none."""


class _Formats(dict[int, Any]):
    """Formats by their number, none so short that the reader would stay where it is for ever."""

    def __setitem__(self, number: int, fmt: Any) -> None:
        if fmt.len < HEAD:
            raise ValueError(f"messages of {fmt.len} bytes")
        super().__setitem__(number, fmt)


class _First(io.StringIO):
    """The first line that the reader prints, of a fault; it prints one for each byte that it passes over."""

    def write(self, text: str) -> int:
        return super().write(text) if "\n" not in self.getvalue() else len(text)


def read(path: Path) -> Recording:
    """The file: a table a message and instance, `ATT` or `BAT#1`, on the autopilot's clock since boot. BadFileError."""
    from pymavlink.DFReader import DFReader_binary

    class Reader(DFReader_binary):  # type: ignore[misc] # the indexer in C prints past Python's streams
        formats: dict[int, Any]

        def init_arrays_fast(self, progress_callback: None = None) -> None:
            self.formats = _Formats(self.formats)
            self.init_arrays(progress_callback)

        def __init__(self, filename: str) -> None:
            try:
                super().__init__(filename)
            except Exception:
                self.filehandle.close()
                raise

    printed = _First()
    data = np.fromfile(path, np.uint8)
    with parsing(path), contextlib.redirect_stdout(printed), contextlib.redirect_stderr(printed):
        log = Reader(str(path))
        with contextlib.closing(log):
            kinds = [(fmt, np.array(log.offsets[kind], np.int64)) for kind, fmt in log.formats.items()]
            texts = tuple(_texts(log))
            parameters = {str(name): float(value) for name, value in log.params.items()}
    tables = dict(pair for fmt, offsets in kinds for pair in _tables(path, fmt, data, offsets))
    ends = [int(offsets[-1]) + fmt.len for fmt, offsets in kinds if len(offsets)]
    damage, faults = "", printed.getvalue().strip().splitlines()
    if max(ends, default=0) > len(data):
        damage = f"{path}: ends inside a message, at byte {len(data)}; what is before that is imported"
    elif faults:
        damage = f"{path}: {plain(faults[0], 80)}; what can be read of it is imported"
    return Recording(path, KIND, tables, damage=damage, texts=texts, parameters=parameters)


def _texts(log: Any) -> Iterator[tuple[float, int, str]]:
    """Its messages to the pilot; the parameters are read on the way."""
    while (message := log.recv_match(type=["MSG", "PARM"])) is not None:
        if message.get_type() == "MSG" and STAMP in message.fmt.columns:
            yield 1e-6 * message.TimeUS, INFO, plain(str(message.Message), LONGEST_TEXT)


def _tables(path: Path, fmt: Any, data: Values, offsets: Values) -> Iterator[tuple[str, Table]]:
    """The messages of one format, a table an instance; none of one whose size is not what its format says."""
    codes = [NUMBERS.get(code) or TEXTS.get(code, "") for code in fmt.format.rstrip("\0")]
    offsets = offsets[offsets + fmt.len <= len(data)]
    if (
        fmt.name in ITSELF
        or STAMP not in fmt.columns
        or not len(offsets)
        or not all((*codes, *fmt.columns))
        or len(codes) != len(fmt.columns)
    ):
        return
    layout = (
        np.dtype(list(zip(fmt.columns, codes, strict=True))) if len(set(fmt.columns)) == len(codes) else np.dtype("V0")
    )
    if layout.itemsize + HEAD != fmt.len:
        return
    rows = np.ascontiguousarray(data[offsets[:, None] + np.arange(HEAD, fmt.len)]).view(layout)[:, 0]
    scales = dict(zip(fmt.columns, fmt.msg_mults, strict=False))
    columns = {
        name: rows[name] * (scales[name] or 1)
        for name in fmt.columns
        if layout[name].kind != "V" and name not in (STAMP, fmt.instance_field)
    }
    t_s = rows[STAMP].astype(np.float64) * 1e-6
    instances = rows[fmt.instance_field] if fmt.instance_field in fmt.columns else np.zeros(len(rows), np.int64)
    for number in np.unique(instances).tolist() if instances.dtype.kind in "iu" else ():
        of_one = instances == number
        name = f"{fmt.name}#{number}" if number else fmt.name
        found = table(path, name, t_s[of_one], {key: values[of_one] for key, values in columns.items()})
        if found is not None:
            yield name, found

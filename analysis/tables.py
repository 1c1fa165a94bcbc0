"""A log as tables of plain columns, one table a topic: for notebooks, CSV and Parquet. Every float64 bit for bit.

A table is a mapping from column to an array (T,), so that `pandas.DataFrame(table)` is one call. Messages about several
vehicles become one row a vehicle, named in `body`. Vectors become `pos_lab_m_x`, `_y`, `_z`, quaternions `_w` first.
"""

import csv
import json
import pickle
import sys
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from enum import Enum
from pathlib import Path
from typing import Any, get_args, get_type_hints

import numpy as np
from numpy.typing import NDArray

from analysis.links import histories
from formation.config import LabConfig
from formation.maths.arrays import Layout
from formation.topics import LINK_UP
from wire.logs.mcap_read import LogError, clock_of, holds_nothing, lab_of, read_log

Table = Mapping[str, NDArray[Any]]
LINK = "drone/link"
_AXES = {3: ("_x", "_y", "_z"), 4: ("_w", "_x", "_y", "_z")}


@dataclass(frozen=True, slots=True, eq=False)
class LogTables:
    """What a log says of its run; its tables by topic, those that hold anything; unix_ns: when it began, since 1970.

    In every table: `t_s`, seconds since the log's first record; `unix_ns`, the date of that, ns since 1970 UTC.
    """

    metadata: Mapping[str, str]
    tables: Mapping[str, Table]
    unix_ns: int


def load(path: Path) -> LogTables:
    """Read a log, whole or damaged. Raises OSError, and LogError (a ValueError) if the file is no MCAP file."""
    log = read_log(path)
    lab = lab_of(log.metadata)
    stamps: defaultdict[str, list[int]] = defaultdict(list)
    found: defaultdict[str, list[Any]] = defaultdict(list)
    first_ns: int | None = None
    for entry in log.entries:
        first_ns = entry.t_ns if first_ns is None else first_ns
        stamps[entry.topic.name].append(entry.t_ns)
        found[entry.topic.name].append(entry.message)
    if not found:
        raise holds_nothing(path)
    clock = clock_of(log.metadata)
    tables: dict[str, Table] = {}
    for name, messages in found.items():
        tables[name] = _table(np.array(stamps[name]), messages, lab, first_ns or 0, clock.ahead_ns)
    if LINK_UP.name in found:
        datagrams = zip(stamps[LINK_UP.name], found[LINK_UP.name], strict=True)
        tables[LINK] = _link(datagrams, lab, first_ns or 0, clock.ahead_ns)
    return LogTables(log.metadata, tables, clock.unix_ns)


def _times(t_ns: NDArray[np.int64], first_ns: int, ahead_ns: int) -> dict[str, NDArray[Any]]:
    return {"t_s": (t_ns - first_ns) * 1e-9, "unix_ns": t_ns + ahead_ns}


def _table(
    t_ns: NDArray[np.int64], messages: Sequence[Any], lab: LabConfig | None, first_ns: int, ahead_ns: int
) -> Table:
    """One topic's messages, all of one type."""
    kind = type(messages[0])
    hints = get_type_hints(kind, include_extras=True)
    layouts = {field.name: _layout(hints[field.name]) for field in fields(kind)}
    rowed = [name for name, layout in layouts.items() if layout is not None and layout.shape[0] < 0]
    counts = np.array([len(getattr(message, rowed[0])) for message in messages]) if rowed else None

    def repeated(values: NDArray[Any]) -> NDArray[Any]:
        return values if counts is None else np.repeat(values, counts, axis=0)

    columns = _times(repeated(t_ns), first_ns, ahead_ns)
    if counts is not None:
        columns["body"] = np.concatenate([_bodies(m, int(n), lab) for m, n in zip(messages, counts, strict=True)])
    for name, layout in layouts.items():
        values = [getattr(message, name) for message in messages]
        if layout is None:
            if not (counts is not None and name == "bodies"):
                columns[name] = repeated(_plain(values))
        else:
            rows = np.concatenate(values) if name in rowed else repeated(np.array(values))
            columns |= _split(name, rows)
    return columns


def _layout(hint: Any) -> Layout | None:
    """The shape of an array field; None where it is none."""
    return next((note for note in get_args(hint)[1:] if isinstance(note, Layout)), None)


def _bodies(message: Any, count: int, lab: LabConfig | None) -> NDArray[Any]:
    """Whom a message's rows are about: of its own bodies, of all vehicles, or of the commanded ones."""
    named = getattr(message, "bodies", None)
    if named is None and lab is not None:
        every = [vehicle.body for vehicle in lab.vehicles]
        named = every if len(every) == count else [every[i] for i in lab.commanded]
    names = [str(i) for i in range(count)] if named is None or len(named) != count else named
    return np.array(names, dtype=object)


def _plain(values: list[Any]) -> NDArray[Any]:
    """A column of numbers, flags, texts or bytes; enumerations by name, lists of texts as one text."""
    if isinstance(values[0], Enum):
        values = [value.name for value in values]
    if isinstance(values[0], tuple):
        values = ["; ".join(value) for value in values]
    return np.array(values, dtype=object if isinstance(values[0], str | bytes) else None)


def _split(name: str, rows: NDArray[Any]) -> dict[str, NDArray[Any]]:
    """(T,) as it is; (T, k) as k columns."""
    if rows.ndim == 1:
        return {name: rows}
    flat = rows.reshape(len(rows), -1)
    endings = _AXES.get(flat.shape[1], tuple(f"_{k}" for k in range(flat.shape[1])))
    return {name + ending: flat[:, k] for k, ending in enumerate(endings)}


def _link(datagrams: Iterator[tuple[int, Any]], lab: LabConfig | None, first_ns: int, ahead_ns: int) -> Table:
    """One row for each drone and tenth of a second: its last battery, link and mode."""
    body_of = {} if lab is None else {vehicle.sysid: vehicle.body for vehicle in lab.vehicles}
    parts = []
    for sysid, history in histories(datagrams).items():
        rest = dict(history)
        t_ns = np.asarray(rest.pop("t_ns"), np.int64)
        body = np.full(len(t_ns), body_of.get(sysid, str(sysid)), dtype=object)
        parts.append(_times(t_ns, first_ns, ahead_ns) | {"body": body} | rest)
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def main() -> None:
    """For `gcs_log.load`, which runs in other people's processes: the log of argv as a pickle on standard output.

    Exit code 1 and one line on standard error where it cannot be read.
    """
    try:
        loaded = load(Path(sys.argv[1]))
    except (OSError, LogError) as error:
        sys.exit(f"{error}")
    content = dict(loaded.metadata), {name: dict(table) for name, table in loaded.tables.items()}, loaded.unix_ns
    pickle.dump(content, sys.stdout.buffer, protocol=5)


if __name__ == "__main__":
    main()


WITHOUT_PYARROW = "--parquet needs pyarrow: pip install 'mavlink-formation[parquet]'"


def to_csv(log: LogTables, folder: Path) -> list[Path]:
    """One TOPIC.csv a table, and metadata.json; numbers with every digit they have, bytes in hexadecimal. OSError."""
    written = [_metadata(log, folder)]
    for topic, table in log.tables.items():
        path = folder / f"{_name(topic)}.csv"
        with path.open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file)
            writer.writerow(table)
            writer.writerows(zip(*(_texts(column.tolist()) for column in table.values()), strict=True))
        written.append(path)
    return written


def to_parquet(log: LogTables, folder: Path) -> list[Path]:
    """One TOPIC.parquet a table, and metadata.json. OSError; LogError without pyarrow."""
    try:
        import pyarrow as pa
        import pyarrow.parquet as pq
    except ImportError as error:
        raise LogError(WITHOUT_PYARROW) from error
    written = [_metadata(log, folder)]
    for topic, table in log.tables.items():
        path = folder / f"{_name(topic)}.parquet"
        pq.write_table(pa.table(_arrays(table)), path)
        written.append(path)
    return written


def _name(topic: str) -> str:
    return topic.replace("/", "-")


def _metadata(log: LogTables, folder: Path) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "metadata.json"
    path.write_text(json.dumps(dict(log.metadata), indent=2), encoding="utf-8")
    return path


def _texts(column: list[object]) -> list[object]:
    return [value.hex() for value in column if isinstance(value, bytes)] or column


def _arrays(table: Table) -> dict[str, object]:
    """Columns as pyarrow takes them: objects as lists of what they are."""
    return {name: column.tolist() if column.dtype == object else column for name, column in table.items()}

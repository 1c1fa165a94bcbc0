"""A log as tables of plain columns, one table a topic: for notebooks, CSV and Parquet. Every float64 bit for bit.

A table is a mapping from column to an array (T,), so that `pandas.DataFrame(table)` is one call. Messages about several
vehicles become one row a vehicle, named in `body`. Vectors become `pos_lab_m_x`, `_y`, `_z`, quaternions `_w` first.
"""

import csv
import json
import pickle
import sys
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from enum import Enum
from functools import cache, cached_property
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_args, get_type_hints

import numpy as np
from numpy.typing import NDArray

from analysis.reading import Rows, signal_rows
from formation import topics
from formation.maths.arrays import Layout
from formation.topics import LINK_UP, Topic
from mavlink_formation.installation import install_command
from wire.columns import Column
from wire.logs.mcap_read import LogColumns, TopicColumns, clock_of, holds_nothing, lab_of, read_columns
from wire.logs.mcap_scan import LogError

if TYPE_CHECKING:
    from formation.config import LabConfig

Table = Mapping[str, NDArray[Any]]
LINK = "drone/link"
IMPORTED = (topics.SIGNAL, topics.COLUMN)
"""Topics of which every table is one of its own, `import/signal/rates`."""
_AXES = {3: ("_x", "_y", "_z"), 4: ("_w", "_x", "_y", "_z")}


@dataclass(frozen=True, slots=True, eq=False)
class LogTables:
    """What a log says of its run; names: of the tables that it holds; unix_ns: when it began, since 1970.

    tables: those that were asked for, each made when it is reached, and once only. In every table: `t_s`, seconds since
    the log's first record; `unix_ns`, the date of that, ns since 1970 UTC.
    """

    metadata: Mapping[str, str]
    names: tuple[str, ...]
    unix_ns: int
    tables: Iterator[tuple[str, Table]]


def load(path: Path, wanted: Collection[str] | None = None) -> LogTables:
    """Read a log, whole or damaged. wanted: the names of the tables; None: all.

    Raises OSError, and LogError (a ValueError) if the file is no MCAP file, or holds no message of a flight.
    """
    asked = frozenset((*(topic.name for topic in topics.ALL), LINK) if wanted is None else wanted)
    read = [topic for topic in topics.ALL if topic.name in asked or (topic is LINK_UP and LINK in asked)]
    read += [topic for topic in IMPORTED if any(name.startswith(topic.name) for name in asked) and topic not in read]
    of_topics = {topic: [field.name for field in fields(topic.type)] for topic in read}
    log = read_columns(path, {topic: ["table"] for topic in IMPORTED} | of_topics)
    if not log.held:
        raise holds_nothing(path, log.check.damage)
    imported = [f"{topic.name}/{each}" for topic in IMPORTED for each in _held(log.topics.get(topic))]
    plain = [topic.name for topic in topics.ALL if topic in log.held and topic not in IMPORTED]
    names = (*plain, *([LINK] if LINK_UP in log.held else []), *imported)
    asked = asked.union(imported) if wanted is None else asked
    return LogTables(log.metadata, names, clock_of(log.metadata).unix_ns, _tables(_Dated(log), dict(log.topics), asked))


class _Dated:
    """What the tables of a log have in common."""

    def __init__(self, log: LogColumns) -> None:
        self.metadata, self.begin_ns = log.metadata, log.begin_ns
        self._ahead_ns = clock_of(log.metadata).ahead_ns

    def times(self, t_ns: NDArray[np.int64]) -> Table:
        """The columns of time, of messages logged then."""
        return {"t_s": (t_ns - self.begin_ns) * 1e-9, "unix_ns": t_ns + self._ahead_ns}

    @cached_property
    def lab(self) -> "LabConfig | None":
        """The lab that was flown; None where it is not known."""
        return lab_of(self.metadata)


def _tables(run: _Dated, columns: dict[Topic, TopicColumns], asked: Collection[str]) -> Iterator[tuple[str, Table]]:
    """The tables of these names; columns that have become a table are let go."""
    for topic in list(columns):
        found = columns.pop(topic)
        if topic in IMPORTED:
            yield from _imported(topic, found, run, asked)
        elif topic.name in asked:
            yield topic.name, _table(topic.type, found, run)
        if topic is LINK_UP and LINK in asked:
            yield LINK, _link(found, run)


def _table(kind: type, found: TopicColumns, run: _Dated) -> Table:
    """One topic's messages, all of one type."""
    hints = get_type_hints(kind, include_extras=True)
    layouts = {field.name: _layout(hints[field.name]) for field in fields(kind)}
    rowed = {name: found.fields[name].flat() for name, layout in layouts.items() if layout and layout.shape[0] < 0}
    counts = next(iter(rowed.values()))[1] if rowed else None

    def repeated(values: NDArray[Any]) -> NDArray[Any]:
        return values if counts is None else np.repeat(values, counts, axis=0)

    columns = dict(run.times(repeated(found.t_ns)))
    if counts is not None:
        columns["body"] = _bodies(found, counts.tolist(), run)
    for name, layout in layouts.items():
        if layout is not None:
            columns |= _split(name, rowed[name][0] if name in rowed else repeated(found.fields[name].values))
        elif counts is None or name != "bodies":
            columns[name] = repeated(_plain(hints[name], found.fields[name]))
    return columns


def _held(found: TopicColumns | None) -> list[str]:
    """The names of the tables in messages of `SignalRows`, in order of their first."""
    return [] if found is None else list(dict.fromkeys(found.fields["table"].values.tolist()))


def _imported(topic: Topic, found: TopicColumns, run: _Dated, asked: Collection[str]) -> Iterator[tuple[str, Table]]:
    """Each table that another recorder wrote, its vehicles' rows one behind the other."""
    wanted = [table for table in _held(found) if f"{topic.name}/{table}" in asked]
    rows = signal_rows(found) if wanted else {}
    for table in wanted:
        parts = [(body, part) for (body, name), part in rows.items() if name == table]
        names = dict.fromkeys(name for _, part in parts for name in part.names)
        columns = {name: np.concatenate([_column(part, name) for _, part in parts]) for name in names}
        body = np.concatenate([np.full(len(part.t_ns), body, dtype=object) for body, part in parts])
        times = run.times(np.concatenate([part.t_ns for _, part in parts]))
        yield f"{topic.name}/{table}", {**times, "body": body} | columns


def _column(rows: Rows, name: str) -> NDArray[Any]:
    return rows.values[:, rows.names.index(name)] if name in rows.names else np.full(len(rows.t_ns), np.nan)


def _layout(hint: Any) -> Layout | None:
    """The shape of an array field; None where it is none."""
    return next((note for note in get_args(hint)[1:] if isinstance(note, Layout)), None)


def _bodies(found: TopicColumns, counts: Sequence[int], run: _Dated) -> NDArray[Any]:
    """Whom the rows are about: the messages' own bodies, or all vehicles, or the commanded ones."""
    if "bodies" in found.fields:
        named = found.fields["bodies"].values.tolist()
    else:
        of_count = {count: _vehicles(run.lab, count) for count in set(counts)}
        named = [of_count[count] for count in counts]
    numbers = cache(lambda count: [str(i) for i in range(count)])
    names = (each if len(each) == count else numbers(count) for each, count in zip(named, counts, strict=True))
    return np.array(list(chain.from_iterable(names)), dtype=object)


def _vehicles(lab: "LabConfig | None", count: int) -> Sequence[str]:
    if lab is None:
        return ()
    every = [vehicle.body for vehicle in lab.vehicles]
    return every if len(every) == count else [every[i] for i in lab.commanded]


def _plain(hint: Any, column: Column) -> NDArray[Any]:
    """A column of numbers, flags, texts or bytes; enumerations by name, lists of texts as one text."""
    if hint is bytes:
        return np.array(column.pieces(), dtype=object)
    values = column.values
    if isinstance(values[0], Enum):
        return np.array([value.name for value in values.tolist()], dtype=object)
    if isinstance(values[0], tuple):
        return np.array(["; ".join(value) for value in values.tolist()], dtype=object)
    return values


def _split(name: str, rows: NDArray[Any]) -> dict[str, NDArray[Any]]:
    """(T,) as it is; (T, k) as k columns; single precision as double."""
    rows = rows.astype(np.float64) if rows.dtype == np.float32 else rows
    if rows.ndim == 1:
        return {name: rows}
    flat = rows.reshape(len(rows), -1)
    endings = _AXES.get(flat.shape[1], tuple(f"_{k}" for k in range(flat.shape[1])))
    return {name + ending: flat[:, k] for k, ending in enumerate(endings)}


def _link(found: TopicColumns, run: _Dated) -> Table:
    """One row for each drone and tenth of a second: its last battery, link and mode. found: what drones sent."""
    from analysis.links import histories
    from analysis.load import traffic

    body_of = {} if run.lab is None else {vehicle.sysid: vehicle.body for vehicle in run.lab.vehicles}
    parts = []
    for sysid, history in histories(traffic(LINK_UP, found, run.begin_ns)).items():
        rest = dict(history)
        t_ns = np.asarray(rest.pop("t_ns"), np.int64) + run.begin_ns
        body = np.full(len(t_ns), body_of.get(sysid, str(sysid)), dtype=object)
        parts.append({**run.times(t_ns), "body": body} | rest)
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def main() -> None:
    """For `gcs_log.load`, which runs in other people's processes: the log of argv as pickles on standard output.

    The first is of its metadata, its tables' names and its date; then one of each table whose name is behind the log's
    path. Exit code 1 and one line on standard error where it cannot be read.
    """
    path, *wanted = sys.argv[1:]
    try:
        log = load(Path(path), wanted)
    except (OSError, LogError) as error:
        sys.exit(f"{error}")
    for content in chain([(dict(log.metadata), log.names, log.unix_ns)], log.tables):
        pickle.dump(content, sys.stdout.buffer, protocol=5)


if __name__ == "__main__":
    main()


def to_csv(log: LogTables, folder: Path, progress: Callable[[str], None] = lambda _text: None) -> list[Path]:
    """One TOPIC.csv a table, and metadata.json; numbers with every digit they have, bytes in hexadecimal. OSError."""
    written = [_metadata(log, folder)]
    for topic, table in log.tables:
        progress(f"writing {topic}")
        path = folder / f"{_name(topic)}.csv"
        with path.open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file)
            writer.writerow(table)
            writer.writerows(zip(*(_texts(column.tolist()) for column in table.values()), strict=True))
        written.append(path)
    return written


def to_parquet(log: LogTables, folder: Path, progress: Callable[[str], None] = lambda _text: None) -> list[Path]:
    """One TOPIC.parquet a table, and metadata.json. OSError; LogError without pyarrow."""
    try:
        import pyarrow as pa
        import pyarrow.parquet as pq
    except ImportError as error:
        raise LogError(f"--parquet needs pyarrow: {install_command('parquet')}") from error
    written = [_metadata(log, folder)]
    for topic, table in log.tables:
        progress(f"writing {topic}")
        path = folder / f"{_name(topic)}.parquet"
        pq.write_table(pa.table(_arrays(table)), path)
        written.append(path)
    return written


def _name(topic: str) -> str:
    return topic.replace("/", "-")


def _metadata(log: LogTables, folder: Path) -> Path:
    path = folder / "metadata.json"
    path.write_text(json.dumps(dict(log.metadata), indent=2), encoding="utf-8")
    return path


def _texts(column: list[object]) -> list[object]:
    return [value.hex() for value in column if isinstance(value, bytes)] or column


def _arrays(table: Table) -> dict[str, object]:
    """Columns as pyarrow takes them: objects as lists of what they are."""
    return {name: column.tolist() if column.dtype == object else column for name, column in table.items()}

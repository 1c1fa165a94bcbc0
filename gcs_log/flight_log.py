"""A flight's log as tables, read by a process of its own. Imports numpy and the standard library, nothing else."""

import pickle
import subprocess
import sys
from collections.abc import ItemsView, Iterator, Mapping, ValuesView
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from html import escape
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

Table = Mapping[str, NDArray[Any]]
# Neither the folder of a notebook (`-P`) nor PYTHONPATH has modules for it.
READER = (sys.executable, "-P", "-m", "mavlink_formation", "analysis.tables")


class LogError(ValueError):
    """The file is no log; says which file, and why."""


@dataclass(frozen=True, slots=True, repr=False)
class FlightLog(Mapping[str, Table]):
    """A log: its tables by topic (those that hold anything), and what it says of its run.

    In every table: `t_s`, seconds since the log's first record; `unix_ns`, the date of that, ns since 1970 UTC.
    A table is read when it is first looked at; `items` and `values` read all of them at once.
    """

    metadata: Mapping[str, str]
    tables: Mapping[str, Table]
    _unix_ns: int

    @property
    def date(self) -> datetime:
        """When it began, UTC; simulated flights begin in 2000, logs of versions before 0.2 in 1970."""
        return datetime.fromtimestamp(self._unix_ns / 1e9, UTC)

    def __getitem__(self, topic: str) -> Table:
        return self.tables[topic]

    def __iter__(self) -> Iterator[str]:
        return iter(self.tables)

    def __len__(self) -> int:
        return len(self.tables)

    def items(self) -> ItemsView[str, Table]:
        """Topics and tables, of which all that are missing are read at once."""
        return self.tables.items()

    def values(self) -> ValuesView[Table]:
        """The tables, as by `items`."""
        return self.tables.values()

    def __repr__(self) -> str:
        """The topics as a table of text."""
        lines = _overview(self.tables)
        widths = [max(len(line[k]) for line in lines) for k in range(len(lines[0]))]
        rows = (
            "  ".join(word.ljust(width) for word, width in zip(line, widths, strict=True)).rstrip() for line in lines
        )
        return "\n".join((f"flight log of {self.date:%Y-%m-%d %H:%M:%S} UTC", *rows))

    def _repr_html_(self) -> str:
        """The same for a notebook."""
        head, *rows = ("".join(f"<td>{escape(word)}</td>" for word in line) for line in _overview(self.tables))
        body = "".join(f"<tr>{row}</tr>" for row in rows)
        return f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"


def _overview(tables: Mapping[str, Table]) -> list[tuple[str, ...]]:
    """A line a topic under a line of heads: rows, from when to when, columns."""
    lines: list[tuple[str, ...]] = [("topic", "rows", "t_s", "columns")]
    for topic, table in sorted(tables.items()):
        t_s, columns = table["t_s"], [name for name in table if name not in ("t_s", "unix_ns")]
        shown = ", ".join(columns[:5]) + (", ..." if len(columns) > 5 else "")
        lines.append((topic, str(len(t_s)), f"{t_s.min():.1f} to {t_s.max():.1f}", shown))
    return lines


class _Tables(Mapping[str, Table]):
    """A log's tables, each read when it is first looked at."""

    def __init__(self, path: Path, names: tuple[str, ...]) -> None:
        self._path, self._names = path, names
        self._read: dict[str, Table] = {}

    def __getitem__(self, name: str) -> Table:
        if name not in self._names:
            raise KeyError(name)
        table = self._load((name,)).get(name)
        if table is None:
            raise LogError(f"{self._path}: no message of {name} can be read")
        return table

    def __iter__(self) -> Iterator[str]:
        return iter(self._names)

    def __len__(self) -> int:
        return len(self._names)

    def items(self) -> ItemsView[str, Table]:
        self._load(self._names)
        return super().items()

    def values(self) -> ValuesView[Table]:
        self._load(self._names)
        return super().values()

    def _load(self, names: tuple[str, ...]) -> Mapping[str, Table]:
        """All that were read, these among them."""
        missing = [name for name in names if name not in self._read]
        if missing:
            self._read |= dict(_contents(self._path, *missing)[1:])
        return self._read


def load(path: str | Path) -> FlightLog:
    """Read a log, whole or damaged. Raises OSError, and LogError (a ValueError) if the file is no MCAP file."""
    path = Path(path).absolute()
    path.open("rb").close()
    [(metadata, names, unix_ns)] = _contents(path)
    return FlightLog(metadata, _Tables(path, names), unix_ns)


def _contents(path: Path, *names: str) -> list[Any]:
    """A log's metadata, the names of its tables and its date; then each of the tables that are named, with its name.

    LogError.
    """
    contents = list[Any]()
    with subprocess.Popen([*READER, str(path), *names], stdout=subprocess.PIPE, stderr=subprocess.PIPE) as reader:
        assert reader.stdout is not None
        assert reader.stderr is not None
        with suppress(EOFError, pickle.UnpicklingError):
            while True:
                contents.append(pickle.load(reader.stdout))
        words = reader.stderr.read().decode(errors="replace")
    if reader.returncode != 0:
        raise LogError(words.strip().rpartition("\n")[2])
    return contents

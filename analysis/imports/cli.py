"""What `gcs-log import` does: find the format of each file, read it, map it, write one log."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

from analysis.imports import csv_file
from analysis.imports.maps import TIME, ImportMap, map_of, read_map
from analysis.imports.recording import BadFileError, Recording, demand_one_time
from analysis.imports.signals import Imported, imported
from analysis.imports.write import write
from wire.errors import ConfigError

BEGINNING = 64
"""Bytes of a file that show its format."""
Reader = Callable[[Path], Recording]
READERS: Mapping[bytes, Reader] = MappingProxyType({})


@dataclass(frozen=True, slots=True)
class ImportedFile:
    """What a file gave: quantities by the names that a map gives them, and how many columns no map names."""

    file: str
    kind: str
    map: str
    body: str
    quantities: tuple[str, ...]
    other_columns: int


@dataclass(frozen=True, slots=True)
class Result:
    """The log that was written. damage: what was lost of the files, a line each."""

    file: str
    vehicles: tuple[ImportedFile, ...]
    damage: tuple[str, ...]

    @property
    def text(self) -> str:
        """A line a vehicle, and the log's."""
        lines = [
            f"{v.file}: {v.kind}, by the map {v.map}: {v.body} has {', '.join(v.quantities)}; "
            f"{v.other_columns} other columns"
            for v in self.vehicles
        ]
        return "\n".join((*lines, self.file))


def import_files(files: Sequence[Path], out: Path, by: Path | None, show: Callable[[str], None]) -> Result:
    """Read, map and write. ConfigError for a map or option, BadFileError for a file, OSError."""
    wanted = None if by is None else read_map(by)
    found = list[Imported]()
    for number, path in enumerate(files, 1):
        show(f"reading {path}")
        recording, chosen = read(path, wanted)
        body = chosen.body if chosen.body and len(files) == 1 else _body(path, number, [each.body for each in found])
        found.append(imported(recording, chosen, body))
    show(f"writing {out}")
    write(found, out)
    vehicles = tuple(
        ImportedFile(
            str(each.recording.path), each.recording.kind, each.title, each.body, tuple(each.quantities),
            sum(len(rows.columns) for rows in each.others.values()),
        )
        for each in found
    )  # fmt: skip
    return Result(str(out), vehicles, tuple(each.recording.damage for each in found if each.recording.damage))


def _body(path: Path, number: int, used: Sequence[str]) -> str:
    """The vehicle's name, of its file's."""
    name = "".join(c if c.isalnum() or c in "_-" else "_" for c in path.stem)[:32].lstrip("-_") or f"drone{number}"
    return f"{name}-{number}"[:40] if name in used else name


def read(path: Path, by: ImportMap | None) -> tuple[Recording, ImportMap]:
    """One file, by this map or the shipped one that knows it; raises as `import_files`."""
    with path.open("rb") as file:
        head = file.read(BEGINNING)
    if not head:
        raise BadFileError(f"{path}: is empty")
    reader = next((reader for magic, reader in READERS.items() if head.startswith(magic)), None)
    if reader is None and b"\0" in head:
        raise BadFileError(f"{path}: is none of ULog, DataFlash, a Crazyflie's log, rosbag2 or CSV by its first bytes")
    if reader is None:
        recording, by = _csv(path, by)
    else:
        recording = reader(path)
        by = map_of(path, recording.columns()) if by is None else by
    demand_one_time(recording)
    return recording, by


def _csv(path: Path, by: ImportMap | None) -> tuple[Recording, ImportMap]:
    chosen = list[ImportMap]()

    def clock_of(names: Sequence[str]) -> tuple[str, float]:
        chosen.append(map_of(path, names) if by is None else by)
        clock = chosen[0].clock
        if clock is None or clock.column not in names:
            wanted = "names no clock" if clock is None else f"has its clock in a column {clock.column!r}"
            raise ConfigError([f"{path}: the map {wanted}; columns are {', '.join(names[:8])}, ..."])
        return clock.column, TIME[clock.unit]

    recording = csv_file.read(path, clock_of)
    return recording, chosen[0]

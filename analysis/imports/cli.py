"""What `gcs-log import` does: read each file, map it, write one log."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from analysis.imports.formats import read
from analysis.imports.maps import read_map
from analysis.imports.signals import Imported, imported
from analysis.imports.write import write


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
        with np.errstate(all="ignore"):  # any number may stand in a file
            recording, chosen = read(path, wanted)
            names = [each.body for each in found]
            body = chosen.body if chosen.body and len(files) == 1 else _body(path, number, names)
            found.append(imported(recording, chosen, body))
    show(f"writing {out}")
    with np.errstate(all="ignore"):
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

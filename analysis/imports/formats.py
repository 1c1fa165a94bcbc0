"""The formats of others' logs: which reader a file needs, by its first bytes."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType

from mcap.writer import MCAP0_MAGIC

from analysis.imports import crazyflie, csv_file, dataflash, rosbag2, ulog
from analysis.imports.maps import TIME, ImportMap, map_of
from analysis.imports.recording import BadFileError, Recording, demand_one_time
from wire.errors import ConfigError

BEGINNING = 64
"""Bytes of a file that show its format."""
Reader = Callable[[Path], Recording]
READERS: Mapping[bytes, Reader] = MappingProxyType({
    ulog.MAGIC: ulog.read, dataflash.MAGIC: dataflash.read, crazyflie.MAGIC: crazyflie.read,
    MCAP0_MAGIC: rosbag2.read, b"SQLite format 3\0": rosbag2.read,
})  # fmt: skip
"""By the bytes that a file of theirs begins with."""


def read(path: Path, by: ImportMap | None) -> tuple[Recording, ImportMap]:
    """One file, by this map or the shipped one that knows it. ConfigError for a map, else BadFileError, OSError."""
    head = MCAP0_MAGIC if path.is_dir() else _head(path)
    reader = next((reader for magic, reader in READERS.items() if head.startswith(magic)), None)
    if reader is None and b"\0" in head:
        raise BadFileError(f"{path}: is none of ULog, DataFlash, a Crazyflie's log, rosbag2 or CSV by its first bytes")
    recording, known = _csv(path, by) if reader is None else (reader(path), by)
    demand_one_time(recording)
    if known is not None:
        return recording, known
    try:
        return recording, map_of(path, recording.kind, recording.columns())
    except ConfigError as error:
        if recording.damage:  # which is why
            raise BadFileError(recording.damage) from error
        raise


def _head(path: Path) -> bytes:
    with path.open("rb") as file:
        head = file.read(BEGINNING)
    if not head:
        raise BadFileError(f"{path}: is empty")
    return head


def _csv(path: Path, by: ImportMap | None) -> tuple[Recording, ImportMap]:
    chosen = list[ImportMap]()

    def clock_of(names: Sequence[str]) -> tuple[str, float]:
        chosen.append(map_of(path, csv_file.KIND, names) if by is None else by)
        clock = chosen[0].clock
        if clock is None or clock.column not in names:
            wanted = "names no clock" if clock is None else f"has its clock in a column {clock.column!r}"
            raise ConfigError([f"{path}: the map {wanted}; columns are {', '.join(names[:8])}, ..."])
        return clock.column, TIME[clock.unit]

    recording = csv_file.read(path, clock_of)
    return recording, chosen[0]

"""PX4's ULog, by `pyulog`. https://docs.px4.io/main/en/dev_log/ulog_file_format.html"""

import contextlib
import io
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from analysis.imports.recording import BadFileError, Recording, Table, Values, parsing, table
from mavlink_formation.installation import install_command
from wire.logs.mcap_scan import LogError
from wire.text import plain

KIND = "ULog"
MAGIC = b"ULog\x01\x12\x35"
HEADER = 3
"""Bytes before a message: its size and type."""
MESSAGE_MOST = 65_535
"""Bytes of a message, whose size is written in two: a format that needs more is none."""
LONGEST_TEXT = 200


class _File(io.BufferedReader):
    """The file as pyulog reads it, which goes on where it can: cut_at is where it ends inside a message."""

    cut_at: int | None = None

    def read(self, size: int | None = -1, /) -> bytes:
        data = super().read(size)
        if len(data) < (size or 0) and (data or size != HEADER):
            self.cut_at = self.tell()
        return data


class _Printed(io.StringIO):
    """What pyulog prints: of faults. `at` is where in the file it met the first."""

    def __init__(self, file: _File) -> None:
        super().__init__()
        self._file, self.at = file, -1

    def write(self, text: str) -> int:
        if self.at < 0:
            self.at = self._file.tell()
        return len(text)


def read(path: Path) -> Recording:
    """The file: a table a topic and instance, `name` or `name#1`, on the autopilot's clock since boot.

    BadFileError. What follows a fault, as pyulog finds its way again, is in it; `damage` says so.
    """
    try:
        from pyulog import ULog
    except ImportError as error:
        raise LogError(f"{path}: needs pyulog: {install_command('import')}") from error
    with parsing(path), _File(io.FileIO(path)) as head, _File(io.FileIO(path)) as file:
        with contextlib.redirect_stdout(io.StringIO()):
            _demand_formats(path, ULog(head, parse_header_only=True).message_formats)
        with contextlib.redirect_stdout(_Printed(file)) as printed:
            log = ULog(file)
    stamped = [data for data in log.data_list if "timestamp" in data.data]
    tables = dict(filter(None, (_table(path, data, log.start_timestamp) for data in stamped)))
    size, damage = path.stat().st_size, ""
    if log.file_corruption:
        damage = f"{path}: damaged about byte {max(printed.at, 0)} of {size}; what can be read of it is imported"
    elif file.cut_at is not None:
        damage = f"{path}: ends inside a message, at byte {size}; what is before that is imported"
    texts = tuple(
        (1e-6 * line.timestamp, line.log_level - ord("0"), plain(line.message, LONGEST_TEXT))
        for line in log.logged_messages
    )
    numbers = {name: float(value) for name, value in log.initial_parameters.items() if isinstance(value, int | float)}
    return Recording(path, KIND, tables, damage=damage, texts=texts, parameters=numbers)


def _demand_formats(path: Path, formats: Mapping[str, Any]) -> None:
    """BadFileError for a format that holds itself, or is larger than any message."""
    from pyulog import ULog

    @cache
    def size(name: str, depth: int) -> int:
        if depth > len(formats):
            raise BadFileError(f"{path}: format {plain(name, 40)} holds itself")
        total = 0
        for kind, count, _ in formats[name].fields if name in formats else ():
            one = ULog.get_field_size(kind) if kind in ULog._UNPACK_TYPES else size(kind, depth + 1)
            total += max(count, 1) * one
            if total > MESSAGE_MOST:
                raise BadFileError(f"{path}: format {plain(name, 40)} is larger than a message can be")
        return total

    for name in formats:
        size(name, 0)


def _table(path: Path, data: Any, begin_us: int) -> tuple[str, Table] | None:
    """One topic; stamped with the time of its sample where it says that, else of its publication.

    A log begins with what was published last of each topic, however long before: that is stamped with the beginning.
    """
    columns: dict[str, Values] = dict(data.data)
    published = columns.pop("timestamp")
    sampled = columns.pop("timestamp_sample", None)
    has_samples = sampled is not None and bool(((sampled > 0) & (sampled <= published)).all())
    name = f"{data.name}#{data.multi_id}" if data.multi_id else data.name
    stamps_us = np.asarray(sampled if has_samples else published, np.float64)
    stamps_us[:1] = np.maximum(stamps_us[:1], min([begin_us, *stamps_us[1:2]]))
    found = table(path, name, stamps_us * 1e-6, columns)
    return None if found is None else (name, found)

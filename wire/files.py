"""Files: read whole and bounded, as text or TOML, where a person names them; written for their owner alone.

What a run writes has a name that nothing had: the next free number is taken, or a file that people edit is refused.
"""

import hashlib
import os
import re
import stat
import sys
import tomllib
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from datetime import datetime
from itertools import count
from pathlib import Path
from typing import Any

from wire.errors import ConfigError

MOST = 8 << 20
"""Bytes: of text that was written by hand or exported from a flight; the longest trajectory has a quarter of that."""


def read_text(path: Path, most: int = MOST) -> str:
    """The text in the file without its byte-order mark; raises as `read_bytes` and `text_of`."""
    return text_of(read_bytes(path, most))


def text_of(data: bytes) -> str:
    """The text in these bytes without its byte-order mark; ValueError for what is no UTF-8."""
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise ValueError("not UTF-8 text: save it as UTF-8") from error


def read_bytes(path: Path, most: int = MOST) -> bytes:
    """All that is in the file; ValueError for what is no file, or too long, OSError as ever. most: bytes."""
    mode = path.stat().st_mode
    if not stat.S_ISREG(mode) and not stat.S_ISDIR(mode):  # a folder is refused with its own words
        raise ValueError("not a file")
    with path.open("rb") as file:
        data = file.read(most + 1)
    if len(data) > most:
        raise ValueError(f"more than {most >> 20} MiB")
    return data


def sha256_of(path: Path) -> str:
    """The SHA-256 of a file, hexadecimal; OSError."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


_LONGEST = 120


def private(path: str, flags: int) -> int:
    """An opener (`open(..., opener=private)`) whose new files are their owner's alone, mode 0600. OSError."""
    return os.open(path, flags, 0o600)


def make_folder(path: Path) -> None:
    """Make the folder and those above it, each that is new its owner's alone, mode 0700. OSError."""
    for folder in (*reversed(path.parents), path):
        folder.mkdir(mode=0o700, exist_ok=True)


@contextmanager
def new_files(*wanted: Path, overwrite: bool = False) -> Iterator[tuple[Path, ...]]:
    """Files for this run to write, made empty: of these names or, where one is there, all with the next free number,
    which is reported on standard error. They are gone again where the block raises. OSError.

    overwrite: what is there is written over. What is no file, as /dev/stdout, is written to.
    """
    paths = next(paths for paths in zip(*map(_names, wanted), strict=True) if overwrite or _have_made(paths))
    if paths != wanted:
        _report(wanted[0], paths[0])
    try:
        yield paths
    except BaseException:
        for path in () if overwrite else paths:
            if not _is_stream(path):
                path.unlink(missing_ok=True)
        raise


@contextmanager
def new_file(wanted: Path, overwrite: bool = False) -> Iterator[Path]:
    """One, as `new_files`."""
    with new_files(wanted, overwrite=overwrite) as (path,):
        yield path


def new_folder(wanted: Path, overwrite: bool = False, names: Collection[str] = ()) -> Path:
    """Make a folder for this run: of this name or, where one is there that holds any of these names (none given:
    anything), of the next free number, which is reported on standard error. overwrite: it is used as it is. OSError."""
    for path in _names(wanted):
        make_folder(path.parent)
        try:
            path.mkdir(mode=0o700)
        except FileExistsError:
            if not path.is_dir():
                continue
            held = {each.name for each in path.iterdir()}
            if not overwrite and held & set(names or held):
                continue
        if path != wanted:
            _report(wanted, path)
        return path
    raise AssertionError


def write_edited(path: Path, text: str, overwrite: bool = False) -> None:
    """Write a file that people edit; ConfigError where one is there. OSError."""
    demand_absent(path, overwrite)
    with path.open("w" if overwrite else "x", encoding="utf-8") as file:
        file.write(text)


def demand_absent(path: Path, overwrite: bool) -> None:
    """ConfigError where a file is there that may not be written over."""
    if not overwrite and path.exists() and not _is_stream(path):
        raise ConfigError([f"{path}: it is there already: --overwrite writes over it"])


def _names(wanted: Path) -> Iterator[Path]:
    """The name, then it with each number from 2 on; a folder without a name of its own by its whole path."""
    yield wanted
    full = wanted if wanted.name.strip(".") else wanted.resolve()
    stem, suffix = (full.name, "") if full.is_dir() else (full.stem, full.suffix)
    yield from (full.with_name(f"{stem}-{number}{suffix}") for number in count(2))


def _have_made(paths: tuple[Path, ...]) -> bool:
    """Make all these files, or none where one of them is there."""
    made = list[Path]()
    try:
        for path in paths:
            if not _is_stream(path):
                path.touch(exist_ok=False)
                made.append(path)
    except OSError as error:
        for path in made:
            path.unlink()
        if isinstance(error, FileExistsError):
            return False
        raise
    return True


def _is_stream(path: Path) -> bool:
    """Whether it is a terminal, a pipe or a device."""
    return path.exists() and not path.is_file() and not path.is_dir()


def _report(wanted: Path, new: Path) -> None:
    print(f"{wanted}: the name is in use, so this is {new} (--overwrite writes over it)", file=sys.stderr)


def new_log(wanted: Path, overwrite: bool = False) -> tuple[Path, Path]:
    """The name of a log for this run, as `new_files` takes it, and the file, made its owner's alone, that is written
    until the log is whole. OSError."""
    for log in _names(wanted):
        own = partial(log)
        if overwrite or own == log or not log.exists():
            try:
                own.touch(mode=0o600, exist_ok=own == log)
            except FileExistsError:
                continue
            log = wanted if overwrite else log
            if log != wanted:
                _report(wanted, log)
            return log, own
    raise AssertionError


def finish_log(own: Path, log: Path, overwrite: bool = False) -> Path:
    """Give a whole log its name, or the next free one where that is in use; returns it. OSError."""
    if own == log:
        return log
    with new_file(log, overwrite) as path:
        return own.replace(path)


def partial(log: Path) -> Path:
    """The name under which a log is written until it is whole: whatever reads MCAP opens it, too."""
    return log if _is_stream(log) else log.with_name(f"{log.stem}.partial{log.suffix}")


def is_partial(log: Path) -> bool:
    """Whether that is a log's name while it is not whole."""
    return log.stem.endswith(".partial")


def recorded(log: Path) -> Path:
    """The log or, where its writer was killed, what it wrote."""
    return partial(log) if partial(log).exists() and not log.exists() else log


IN_LOCKSTEP = ("flight.mcap", "flight.partial.mcap", "report.html")
"""What a flight in one process writes into its folder."""
BY_PROCESSES = (*IN_LOCKSTEP, "scenario.toml", "lab.toml")
"""What one by real processes writes, beside a configuration and an output of each."""


def run_folder(name: str, unix_us: int) -> Path:
    """Where a flight is kept that is given no place: runs/TIME-NAME, local time; the log in it is flight.mcap."""
    return Path("runs") / f"{datetime.fromtimestamp(unix_us * 1e-6):%Y%m%d-%H%M%S}-{name}"


def inside(folder: Path, name: str) -> Path:
    """A file of `folder` called `name`, what is no letter, digit or one of . _ - replaced; never outside, never hidden.

    Two names that differ only in what is replaced are one file.
    """
    safe = re.sub(r"[^A-Za-z0-9_.-]+", "_", name)[:_LONGEST].lstrip(".") or "_"
    return folder / safe


INCLUDE = "include"


def read_toml(path: Path) -> dict[str, Any]:
    """The values in the file, laid over those of the one that it includes, by a path from its own folder. ConfigError.

    What the file itself says wins, key by key; a list is one value. Paths in both are from the file's folder.
    """
    values = _read_one(path)
    included = values.pop(INCLUDE, None)
    if included is None:
        return values
    if not isinstance(included, str):
        raise ConfigError([f"{path}: {INCLUDE}: is not the name of a file in quotes (it is {included!r})"])
    try:
        below = _read_one(path.parent / included)
    except ConfigError as error:
        raise ConfigError([f"{path}: {INCLUDE}: {problem}" for problem in error.problems]) from error
    if INCLUDE in below:
        raise ConfigError([f"{path.parent / included}: {INCLUDE}: {path} includes this file, which may include none"])
    return _laid_over(below, values)


def _laid_over(below: dict[str, Any], above: dict[str, Any]) -> dict[str, Any]:
    both = {key for key in below.keys() & above.keys() if isinstance(below[key], dict) and isinstance(above[key], dict)}
    return below | above | {key: _laid_over(below[key], above[key]) for key in both}


def _read_one(path: Path) -> dict[str, Any]:
    """The values in the file; ConfigError for one that is missing, not UTF-8, or no TOML."""
    try:
        return tomllib.loads(read_text(path))
    except OSError as error:
        raise ConfigError([f"{path}: {error.strerror}"]) from error
    except RecursionError as error:
        raise ConfigError([f"{path}: nested too deeply"]) from error
    except ValueError as error:  # no file that can be read, or no TOML
        raise ConfigError([f"{path}: {error}"]) from error

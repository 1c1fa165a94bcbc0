"""Files: read whole and bounded, as text or TOML, where a person names them; written for their owner alone."""

import hashlib
import os
import re
import stat
import tomllib
from datetime import datetime
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


def run_folder(name: str, unix_us: int) -> Path:
    """Where a flight is kept that is given no place: runs/TIME-NAME, local time; the log in it is flight.mcap."""
    return Path("runs") / f"{datetime.fromtimestamp(unix_us * 1e-6):%Y%m%d-%H%M%S}-{name}"


def inside(folder: Path, name: str) -> Path:
    """A file of `folder` called `name`, what is no letter, digit or one of . _ - replaced; never outside, never hidden.

    Two names that differ only in what is replaced are one file.
    """
    safe = re.sub(r"[^A-Za-z0-9_.-]+", "_", name)[:_LONGEST].lstrip(".") or "_"
    return folder / safe


def read_toml(path: Path) -> dict[str, Any]:
    """The values in the file; ConfigError for one that is missing, not UTF-8, or no TOML."""
    try:
        return tomllib.loads(read_text(path))
    except OSError as error:
        raise ConfigError([f"{path}: {error.strerror}"]) from error
    except RecursionError as error:
        raise ConfigError([f"{path}: nested too deeply"]) from error
    except ValueError as error:  # no file that can be read, or no TOML
        raise ConfigError([f"{path}: {error}"]) from error

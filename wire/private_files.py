"""Files that nobody else on the machine need read, and names from outside that stay inside their folder."""

import os
import re
from datetime import datetime
from pathlib import Path

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

"""Files that a person names, read whole: only what is a file, and only so much."""

import stat
from pathlib import Path

MOST = 8 << 20
"""Bytes: of text that was written by hand or exported from a flight; the longest trajectory has a quarter of that."""


def read_text(path: Path) -> str:
    """The text in the file; ValueError for what is no file, too long or no UTF-8, OSError as ever."""
    mode = path.stat().st_mode
    if not stat.S_ISREG(mode) and not stat.S_ISDIR(mode):  # a folder is refused with its own words
        raise ValueError("not a file")
    with path.open("rb") as file:
        data = file.read(MOST + 1)
    if len(data) > MOST:
        raise ValueError(f"more than {MOST >> 20} MiB")
    try:
        return data.decode("utf-8")
    except UnicodeDecodeError as error:
        raise ValueError("not UTF-8 text") from error

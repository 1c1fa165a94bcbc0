"""Files that a person names, read whole: only what is a file, and only so much."""

import stat
from pathlib import Path

MOST = 8 << 20
"""Bytes: of text that was written by hand or exported from a flight; the longest trajectory has a quarter of that."""


def read_text(path: Path, most: int = MOST) -> str:
    """The text in the file without its byte-order mark; ValueError for what is no file, too long or no UTF-8, OSError
    as ever. most: bytes."""
    mode = path.stat().st_mode
    if not stat.S_ISREG(mode) and not stat.S_ISDIR(mode):  # a folder is refused with its own words
        raise ValueError("not a file")
    with path.open("rb") as file:
        data = file.read(most + 1)
    if len(data) > most:
        raise ValueError(f"more than {most >> 20} MiB")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise ValueError("not UTF-8 text: save it as UTF-8") from error

"""Where a report's data are: the log beside it, and the tables that `gcs-log export` makes of it."""

import os
from html import escape
from pathlib import Path


def downloads(mcap: str | None, report: str | None) -> str:
    """A row of links relative to the page; empty where no file is known. Tables exist once they have been exported."""
    if mcap is None or report is None:
        return ""
    log = Path(mcap)
    beside = Path(os.path.relpath(log.resolve(), Path(report).resolve().parent))
    parts = [f"Data: {_link(beside, f'log ({beside.name})')}"]
    for name, option in (("CSV", "csv"), ("Parquet", "parquet")):
        folder = beside.with_name(f"{beside.stem}-{option}")
        parts.append(f"{_link(folder, name)} after <code>gcs-log export {escape(log.name)} --{option}</code>")
    return f'<p class="downloads">{" · ".join(parts)}</p>'


def _link(to: Path, words: str) -> str:
    return f'<a href="{escape(to.as_posix(), quote=True)}">{escape(words)}</a>'

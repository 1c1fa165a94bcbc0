"""The version: the one place that knows the release and the commit it was made from."""

import subprocess
from functools import cache
from pathlib import Path

VERSION = "1.0.0"
_COMMIT = Path(__file__).with_name("commit.txt")
"""In a wheel: written when it is built (hatch_build.py)."""


def text() -> str:
    """ "mavlink-formation 1.0.0, commit 0123456789ab": what programs, logs and reports say."""
    return f"mavlink-formation {VERSION}, commit {commit() or 'unknown'}"


@cache
def commit() -> str:
    """The commit: as the wheel says, else the checkout's own, `+` where that has changed; empty where neither knows."""
    if _COMMIT.exists():
        return _COMMIT.read_text(encoding="utf-8").strip()
    root = _COMMIT.parent.parent
    if not (root / ".git").exists():
        return ""
    command = ["git", "-C", str(root), "describe", "--always", "--abbrev=12", "--exclude=*", "--dirty=+"]
    try:
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()
    except (OSError, subprocess.CalledProcessError):  # no git here, or none that may read this checkout
        return ""

"""How other Python processes of ours are started: they import what is installed, not what the user's folder holds."""

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager


def python_command(module: str, *arguments: str) -> tuple[str, ...]:
    """The command that runs `python -m module arguments` from this installation.

    A folder `sim` beside the user's lab file (`-P`, Python's safe path) or on PYTHONPATH is not imported.
    """
    return (sys.executable, "-P", "-m", "mavlink_formation", module, *arguments)


@contextmanager
def safe_path_for_pools() -> Iterator[None]:
    """While inside, the same holds for processes that `multiprocessing` starts, whose command is not ours to write."""
    before = os.environ.get("PYTHONSAFEPATH")
    os.environ["PYTHONSAFEPATH"] = "1"
    try:
        yield
    finally:
        if before is None:
            del os.environ["PYTHONSAFEPATH"]
        else:
            os.environ["PYTHONSAFEPATH"] = before

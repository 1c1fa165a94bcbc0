"""What every test run needs first: the kernels compiled, outside of any test's time limit; properties that repeat.

A run draws the same few examples every time and judges none by the clock: a red run is the code's doing.
`--hypothesis-profile=searching` draws others every time, and more of them; `make nightly` does.
"""

from pathlib import Path

import pytest
from hypothesis import settings

from sim import lockstep

settings.register_profile("repeatable", deadline=None, derandomize=True, max_examples=40)
settings.register_profile("searching", deadline=None, max_examples=400)
settings.load_profile("repeatable")


def pytest_collection_finish(session: pytest.Session) -> None:
    """Load the compiled kernels where there are tests: neither in xdist's controller nor in a lane without any."""
    if session.items and not session.config.option.collectonly:
        lockstep.warm_up_all()


LANES = {"flights and not nightly": "flights", "processes and not flights and not nightly": "processes"}
"""What `make test` selects for its lanes of processes, and the mark that a file with such a test has in its text."""


def has_mark(file: Path, mark: str) -> bool:
    return f"mark.{mark}" in file.read_text(encoding="utf-8")


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Leave files unread that have no test of the lane: to import them all takes every worker 20 s."""
    mark = LANES.get(config.option.markexpr)
    is_test = collection_path.name.startswith("test_") and collection_path.suffix == ".py"
    return True if mark is not None and is_test and not has_mark(collection_path, mark) else None


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Reject a test of a lane whose file does not say so: that lane would not see it."""
    for mark in LANES.values():
        for file in {item.path for item in items if item.get_closest_marker(mark)}:
            if not has_mark(file, mark):
                raise pytest.UsageError(f"{file}: a test has the mark {mark!r}: write `pytest.mark.{mark}` here")

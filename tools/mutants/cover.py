"""Which test runs which lines of the formation package, and how long it takes: a pytest plugin."""

import signal
import sys
import time
from collections.abc import Generator
from pathlib import Path
from types import FrameType
from typing import Any

import pytest
from pluggy import Result

Lines = dict[str, set[int]]


class TooSlow(BaseException):
    """A test that takes too long to be asked of every change."""


class Cover:
    """Collects, test by test, the lines run of files under `package`; only of tests that pass within slowest_s."""

    def __init__(self, root: Path, package: Path, slowest_s: float) -> None:
        self._slowest_s = slowest_s
        self.tests: dict[str, dict[str, Any]] = {}
        self.failed: list[str] = []
        self._root, self._package = root, str(package)
        self._lines: Lines = {}

    @pytest.hookimpl(hookwrapper=True)
    def pytest_runtest_call(self, item: pytest.Item) -> Generator[None, Result[None], None]:
        self._lines = {}
        began_s = time.process_time()
        signal.signal(signal.SIGVTALRM, _too_slow)
        signal.setitimer(signal.ITIMER_VIRTUAL, self._slowest_s)
        sys.settrace(self._enter)
        outcome = yield
        sys.settrace(None)
        signal.setitimer(signal.ITIMER_VIRTUAL, 0.0)
        if outcome.excinfo and issubclass(outcome.excinfo[0], TooSlow):
            outcome.force_result(None)
            return
        run = {str(Path(f).relative_to(self._root)): sorted(lines) for f, lines in self._lines.items()}
        self.tests[item.nodeid] = {"seconds": time.process_time() - began_s, "lines": run}

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        if report.failed:
            self.tests.pop(report.nodeid, None)
            self.failed.append(report.nodeid)

    def _enter(self, frame: FrameType, event: str, arg: object) -> Any:
        file = frame.f_code.co_filename
        if not file.startswith(self._package):
            return None
        lines = self._lines.setdefault(file, set())

        def line(frame: FrameType, event: str, arg: object) -> Any:
            lines.add(frame.f_lineno)
            return line

        return line


def _too_slow(number: int, frame: FrameType | None) -> None:
    raise TooSlow

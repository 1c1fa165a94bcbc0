"""One wrong module at a time, in a forked process that imports it in the source's place, and the tests run on it."""

import os
import resource
import signal
import sys
import time
from collections.abc import Generator, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec, SourceFileLoader
from importlib.util import spec_from_file_location
from multiprocessing import get_context
from multiprocessing.connection import Connection, wait
from pathlib import Path
from types import CodeType, FrameType, ModuleType
from typing import Any, cast

import pytest
from pluggy import Result as Outcome

ROOT = Path(__file__).resolve().parents[2]
TESTS = ("tests/formation", "tests/drone_agent/guard")
"""The guard's are those of formation/navigation."""
FORK = get_context("fork")


@dataclass(frozen=True, slots=True)
class Mutant:
    """A wrong module: its source's tree compiled, what it is called, and the tests that run the wrong line."""

    name: str
    file: str
    code: CodeType
    tests: tuple[str, ...]
    limit_s: float
    line: str = ""
    change: str = ""


@dataclass(frozen=True, slots=True)
class Result:
    """killer: the first test that failed, "time" or "import"; empty if none did."""

    mutant: Mutant
    killer: str
    seconds: float


class TooSlow(BaseException):
    """A test that takes too long to be asked of every change."""


class Cover:
    """A pytest plugin: test by test, the lines run of files under `package`; of tests that pass within slowest_s."""

    def __init__(self, root: Path, package: Path, slowest_s: float) -> None:
        self._slowest_s = slowest_s
        self.tests: dict[str, dict[str, Any]] = {}
        self.failed: list[str] = []
        self._root, self._package = root, str(package)
        self._lines: dict[str, set[int]] = {}
        self._is_slow = False

    @pytest.hookimpl(hookwrapper=True)
    def pytest_runtest_call(self, item: pytest.Item) -> Generator[None, Outcome[None], None]:
        self._lines, self._is_slow = {}, False
        began_s = time.process_time()
        signal.signal(signal.SIGVTALRM, self._end)
        signal.setitimer(signal.ITIMER_VIRTUAL, self._slowest_s)
        sys.settrace(self._enter)
        outcome = yield
        sys.settrace(None)
        signal.setitimer(signal.ITIMER_VIRTUAL, 0.0)
        if self._is_slow:  # whatever became of the exception on its way through compiled code
            outcome.force_result(None)
            return
        run = {str(Path(f).relative_to(self._root)): sorted(lines) for f, lines in self._lines.items()}
        self.tests[item.nodeid] = {"seconds": time.process_time() - began_s, "lines": run}

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        if report.failed:
            self.tests.pop(report.nodeid, None)
            self.failed.append(report.nodeid)

    def _end(self, number: int, frame: FrameType | None) -> None:
        self._is_slow = True
        raise TooSlow

    def _enter(self, frame: FrameType, event: str, arg: object) -> Any:
        file = frame.f_code.co_filename
        if not file.startswith(self._package):
            return None
        lines = self._lines.setdefault(file, set())

        def line(frame: FrameType, event: str, arg: object) -> Any:
            lines.add(frame.f_lineno)
            return line

        return line


class Wrong(MetaPathFinder):
    """Imports one module from other code than its file's."""

    def __init__(self, file: str, code: CodeType) -> None:
        self._name, self._file = file[: -len(".py")].replace("/", "."), str(ROOT / file)
        self._code = code

    def find_spec(self, name: str, path: Any = None, target: ModuleType | None = None) -> ModuleSpec | None:
        if name != self._name:
            return None
        code = self._code

        class Loader(SourceFileLoader):
            def get_code(self, fullname: str) -> CodeType:
                return code

        return spec_from_file_location(name, self._file, loader=Loader(name, self._file))


class First:
    """Remembers the first test that failed."""

    nodeid = ""

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        if report.failed and not self.nodeid:
            self.nodeid = report.nodeid

    def pytest_collectreport(self, report: pytest.CollectReport) -> None:
        if report.failed and not self.nodeid:
            self.nodeid = "import"


def trials(mutants: Sequence[Mutant], workers: int) -> Iterator[Result]:
    """Runs them, `workers` at a time; results in the order in which they are known."""
    waiting = list(reversed(mutants))
    running: dict[int, tuple[Mutant, Any, Connection, float]] = {}
    while waiting or running:
        while waiting and len(running) < workers:
            mutant = waiting.pop()
            if not mutant.tests:
                yield Result(mutant, "", 0.0)
                continue
            process, pipe = _begun(mutant)
            running[process.sentinel] = (mutant, process, pipe, time.monotonic())
        for sentinel in wait(list(running)):
            yield _ended(*running.pop(cast(int, sentinel)))


def trial(mutant: Mutant) -> Result:
    """That of one."""
    return next(trials([mutant], 1))


def _begun(mutant: Mutant) -> tuple[Any, Connection]:
    ours, theirs = FORK.Pipe(duplex=False)
    process = FORK.Process(target=_judge, args=(mutant, theirs))
    process.start()
    theirs.close()
    return process, ours


def _ended(mutant: Mutant, process: Any, pipe: Connection, began_s: float) -> Result:
    process.join()
    killer = "time" if process.exitcode == -signal.SIGXCPU else pipe.recv() if pipe.poll() else "import"
    return Result(mutant, killer, time.monotonic() - began_s)


def _judge(mutant: Mutant, out: Connection) -> None:
    """In a process of its own: the tests on the wrong module; sends the first that failed.

    An endless loop ends by what it computes, not by the clock of a machine that others load.
    """
    resource.setrlimit(resource.RLIMIT_CPU, (round(mutant.limit_s), resource.RLIM_INFINITY))
    sys.meta_path.insert(0, Wrong(mutant.file, mutant.code))
    first = First()
    code = run_pytest(["-x", *mutant.tests], [first])
    out.send("" if code == pytest.ExitCode.OK else first.nodeid or "import")


def run_pytest(arguments: list[str], plugins: list[object]) -> int:
    """pytest in this process, silent, with kernels as plain Python and properties tried once, not shrunk."""
    from hypothesis import Phase, settings

    settings.register_profile("mutants", derandomize=True, phases=(Phase.explicit, Phase.generate), deadline=None)
    settings.load_profile("mutants")
    with _silent():
        options = (
            "-q",
            "-p",
            "no:cacheprovider",
            "-Wignore::pytest.PytestAssertRewriteWarning",
            "-Wignore::RuntimeWarning",  # an overflow, which compiled kernels do not tell
            f"--confcutdir={TESTS[0]}",
        )
        return int(pytest.main([*options, *arguments], plugins))


@contextmanager
def _silent() -> Iterator[None]:
    kept = os.dup(1), os.dup(2)
    nothing = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nothing, 1)
    os.dup2(nothing, 2)
    try:
        yield
    finally:
        for number, copy in zip((1, 2), kept, strict=True):
            os.dup2(copy, number)

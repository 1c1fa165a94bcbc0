"""For a lab's own tests: the fixture `formation_flight` flies a scenario in lockstep and holds it to what is required.

    def test_our_line(formation_flight):
        summary = formation_flight("our_line.toml", seed=7, require=["formation_rms_m<0.005", "min_separation_m>0.4"])

`pytest --max-formation-rms 0.005` requires that of every such flight. Each is flown by a process of its own,
`gcs-sim run`: a project may have modules named `sim`, `analysis` or `wire`, and its tests import those.
"""

import json
import re
import shutil
import subprocess
import sys
from collections.abc import Iterable
from contextlib import suppress
from itertools import count
from pathlib import Path
from types import SimpleNamespace
from typing import Protocol

import pytest

MOST = {
    "--max-formation-rms": ("formation_rms_m", "the followers' formation error, RMS, m"),
    "--max-formation-error": ("formation_max_m", "their largest formation error, m"),
    "--max-leader-rms": ("leader_rms_m", "a commanded leader's tracking error, RMS, m"),
}


class FormationFlight(Protocol):
    """What the fixture gives."""

    def __call__(
        self, scenario: str | Path, *, seed: int | None = None, require: Iterable[str] = ()
    ) -> SimpleNamespace:
        """Fly a scenario, shipped by its name or a TOML file; its summary, by the names of `gcs-sim run --json`.

        Fails the test where the flight does not land, or misses what is required; its log and report are then kept
        in `runs/TEST` here, beside those of `gcs-sim run`. Of others they are in the test's temporary folder.
        """


def pytest_addoption(parser: pytest.Parser) -> None:
    """The bounds that hold for every flight of a run."""
    group = parser.getgroup("formation flights")
    for option, (key, meaning) in MOST.items():
        group.addoption(
            option, dest=key, type=float, metavar="M", help=f"at most, of every formation_flight: {meaning}"
        )


@pytest.fixture
def formation_flight(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> FormationFlight:
    """Flies in lockstep; the same scenario and seed give the same numbers."""

    def fly(scenario: str | Path, *, seed: int | None = None, require: Iterable[str] = ()) -> SimpleNamespace:
        bounds = {key: request.config.getoption(key) for key, _ in MOST.values()}
        wanted = [*require, *(f"{key}<={bound}" for key, bound in bounds.items() if bound is not None)]
        # Neither the folder in which the tests run (`-P`) nor PYTHONPATH has modules for it.
        command = [sys.executable, "-P", "-m", "mavlink_formation", "sim", "run", str(scenario), "--json"]
        out = tmp_path_factory.mktemp("flight")
        command += ["--out", str(out)]
        command += [] if seed is None else ["--seed", str(seed)]
        command += [word for requirement in wanted for word in ("--require", requirement)]
        flown = subprocess.run(command, capture_output=True, text=True, check=False)
        if flown.returncode != 0:
            pytest.fail(_failure(scenario, flown, _copy_flight(out, request.node.name)), pytrace=False)
        summary: SimpleNamespace = json.loads(flown.stdout, object_hook=lambda values: SimpleNamespace(**values))
        return summary

    return fly


def _copy_flight(flown: Path, test: str) -> Path:
    """Copy a flight's folder to where a workflow collects flights, under the test's name or its next free number."""
    name = re.sub(r"[^\w.-]+", "-", test)
    for copied in (Path("runs") / (f"{name}-{number}" if number > 1 else name) for number in count(1)):
        with suppress(FileExistsError):
            return Path(shutil.copytree(flown, copied))
    raise AssertionError


def _failure(scenario: str | Path, flown: "subprocess.CompletedProcess[str]", copied: Path) -> str:
    """One line of what went wrong, and where the flight's report is if there is one."""
    lines = [line.strip() for line in flown.stderr.splitlines() if line.strip()]
    last_line = lines[-1].removeprefix("gcs-sim: ") if lines else f"exit code {flown.returncode}"
    report = copied / "report.html"
    return f"{scenario}: {last_line} (see {report})" if report.is_file() else f"{scenario}: {last_line}"

"""In a user's folder there may be modules of any name: no process of ours imports them, and theirs still are theirs."""

import asyncio
import json
import math
import os
import subprocess
import sys
from pathlib import Path

import pytest

from sim.processes import ProcessGroup
from sim.runner import run_all
from tests.sim.short_scenario import SHORT
from wire.process.system import NO_GROUND

pytestmark = pytest.mark.processes
MODULES = ("queue", "asyncio", "socket", "struct", "typing")
PACKAGES = ("sim", "analysis", "wire", "formation", "gcs", "drone_agent", "mocap")
BIN = Path(sys.executable).parent
ROOT = Path(__file__).parents[2]


@pytest.fixture
def hostile(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The working directory: its modules, named as the standard library's and ours, cannot be imported.

    Nor can those of a workspace on PYTHONPATH.
    """
    folder = tmp_path / "theirs"
    folder.mkdir()
    for name in MODULES:
        (folder / f"{name}.py").write_text(f"raise ImportError('the {name} of the working directory')\n")
    for place in (folder, tmp_path / "workspace"):
        place.mkdir(exist_ok=True)
        add_packages(place, f"raise ImportError('a package of {place}')\n")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path / "workspace"))
    monkeypatch.chdir(folder)
    return folder


def add_packages(folder: Path, text: str) -> None:
    for name in PACKAGES:
        (folder / name).mkdir()
        (folder / name / "__init__.py").write_text(text)


def test_whoever_starts_python_does_so_by_its_safe_path() -> None:
    lines = [
        line for name in PACKAGES for file in (ROOT / name).rglob("*.py") for line in file.read_text().splitlines()
    ]
    started = [line for line in lines if "sys.executable" in line]
    assert started
    assert all('"-P"' in line for line in started)


def test_the_processes_of_a_flight_are_started_there(hostile: Path) -> None:
    async def run() -> list[int | None]:
        async with ProcessGroup(hostile) as group:
            children = [await group.start(name, name, ["--version"]) for name in ("gcs", "sim", "drone_agent")]
            return [await child.process.wait() for child in children]

    assert asyncio.run(run()) == [0, 0, 0]


def test_the_workers_of_a_study_are_started_there(hostile: Path) -> None:
    assert run_all(math.sqrt, [1.0, 4.0], lambda: None, workers=2) == [1.0, 2.0]
    assert "PYTHONSAFEPATH" not in os.environ


def test_the_console_programs_work_there(hostile: Path) -> None:
    (hostile / "short.toml").write_text(SHORT)
    for program in ("gcs", "drone-agent", "gcs-log"):
        subprocess.run([BIN / program, "--version"], check=True)
    assert subprocess.run([BIN / "gcs", "stop", "--timeout", "0.01"], check=False).returncode == NO_GROUND
    words = ["run", "short.toml", "--json", "--out", "flight"]
    flown = subprocess.run([BIN / "gcs-sim", *words], check=True, capture_output=True, text=True)
    assert json.loads(flown.stdout)["outcome"] == "landed"


READS = """
import analysis, formation, sim, wire
import gcs_log

assert [module.THEIRS for module in (analysis, formation, sim, wire)] == [True] * 4
log = gcs_log.load("flight.mcap")
assert [str(phase) for phase in log["phase"]["phase"][:2]] == ["GROUND", "ARMED"], log["phase"]
assert log["control/state"]["pos_lab_m_x"].dtype == float


def test_reads():
    assert f"{log.date:%Y}" == "2000"


def test_flies(formation_flight):
    summary = formation_flight("short.toml", seed=3, require=["formation_max_m<0.02", "min_separation_m>0.4"])
    assert (summary.seed, summary.outcome) == (3, "landed")
"""


def test_a_log_is_read_and_a_fixture_flies_beside_packages_of_the_same_names(tmp_path: Path) -> None:
    """By `python -c`, whose path begins with the folder as a kernel's does, and by pytest's two ways."""
    (tmp_path / "short.toml").write_text(SHORT)
    subprocess.run([BIN / "gcs-sim", "run", "short.toml", "--out", "."], cwd=tmp_path, check=True, capture_output=True)
    add_packages(tmp_path, "THEIRS = True\n")
    (tmp_path / "test_reads.py").write_text(READS)
    env = {name: value for name, value in os.environ.items() if not name.startswith("PYTEST_")}
    env["PYTHONPATH"] = str(tmp_path)
    tests = ["-p", "no:cacheprovider", "-q", "test_reads.py"]
    for command in ([sys.executable, "-c", READS], [sys.executable, "-m", "pytest", *tests], [BIN / "pytest", *tests]):
        done = subprocess.run(command, cwd=tmp_path, env=env, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stdout + done.stderr

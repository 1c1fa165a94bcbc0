"""What the manual tells to run without hardware runs, page by page, in the order of the page."""

import os
import re
import shlex
import shutil
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

from tests.docs.manual_pages import BASE_LAB, ROOT, Block, Labs, blocks, name_of, pages, shell_lines

RUN = ("gcs check", "gcs rules", "gcs-sim list", "gcs-sim check", "gcs-sim run", "gcs-log", "drone-agent --stages")
"""What is run: what needs neither drone, cameras, recording, browser nor another process, and ends by itself."""

RERUN = find_spec("rerun") is not None
"""Whether the extra `live` is installed, without which there is no blueprint for Rerun."""


def runs(block: Block) -> list[str]:
    if block.language != "sh":
        return []
    return [
        c
        for c in shell_lines(block)
        if c.startswith(RUN) and "--leader-csv" not in c and (RERUN or not c.endswith(".rbl"))
    ]


RUNNING = [page for page in pages() if any(runs(block) for block in blocks(page))]


SHIPPED = re.compile(r"gcs-sim run (\w+) --seed (\d+) --out (\S+)")
"""A flight that scenario and seed decide (tests/sim/test_lockstep.py): flown once, whatever page asks for it."""


@pytest.fixture(scope="module")
def kept(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where the flights of shipped scenarios are kept for every page."""
    return tmp_path_factory.mktemp("kept")


def followed(command: str, folder: Path, kept: Path) -> None:
    """Run a command of a page in its folder; a flight that another page has flown is copied there."""
    shipped = SHIPPED.fullmatch(command)
    if shipped is None:
        ran(command, folder)
        return
    name, seed, out = shipped.groups()
    flown = kept / f"{name}-{seed}"
    if not flown.exists():
        ran(f"gcs-sim run {name} --seed {seed} --out {flown.name}", kept)
    shutil.copytree(flown, folder / out, dirs_exist_ok=True)


def ran(command: str, folder: Path) -> None:
    program, *rest = shlex.split(command)
    path = os.pathsep.join((str(ROOT / "examples" / "own_package"), str(folder / "installed")))
    done = subprocess.run(
        [str(Path(sys.executable).parent / program), *rest],
        check=False, cwd=folder, capture_output=True, text=True, env=os.environ | {"PYTHONPATH": path},
    )  # fmt: skip
    assert done.returncode == 0, f"{command}: {done.stdout[-2000:]}{done.stderr[-2000:]}"


def install_example(folder: Path) -> None:
    """The example package as pip would leave it: its entry points beside its source."""
    project = (ROOT / "examples" / "own_package" / "pyproject.toml").read_text(encoding="utf-8")
    groups = project.partition("[project.entry-points")[2].partition("[tool")[0]
    info = folder / "installed" / "own_formation-1.0.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: own-formation\nVersion: 1.0\n")
    text = f"[project.entry-points{groups}".replace('[project.entry-points."', "[").replace('"]', "]").replace('"', "")
    (info / "entry_points.txt").write_text(text)


@pytest.mark.parametrize("page", RUNNING, ids=name_of)
def test_page_runs(page: Path, kept: Path, tmp_path: Path) -> None:
    followed("gcs-sim run triangle_line --seed 3 --out .", tmp_path, kept)  # pages call it `flight.mcap`
    install_example(tmp_path)
    labs = Labs(BASE_LAB)
    (tmp_path / "lab.toml").write_text(labs.text)
    for block in blocks(page):
        if block.language == "toml":
            labs.take(block)
            (tmp_path / "lab.toml").write_text(labs.text)
            (tmp_path / "scenario.toml").write_text(labs.scenario or "")
        for command in runs(block):
            for word in shlex.split(command):
                if word.endswith(".toml") and not (tmp_path / word).exists():
                    (tmp_path / word).write_text(labs.text)
            followed(command, tmp_path, kept)

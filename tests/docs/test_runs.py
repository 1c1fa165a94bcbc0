"""What the manual tells to run without hardware runs: README and one command of each kind; nightly, every page."""

import os
import re
import shlex
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


def run_page(page: Path, folder: Path) -> None:
    labs = Labs(BASE_LAB)
    (folder / "lab.toml").write_text(labs.text)
    for block in blocks(page):
        if block.language == "toml":
            labs.take(block)
            (folder / "lab.toml").write_text(labs.text)
            (folder / "scenario.toml").write_text(labs.scenario or "")
        for command in runs(block):
            for word in shlex.split(command):
                if word.endswith(".toml") and not (folder / word).exists():
                    (folder / word).write_text(labs.text)
            ran(command, folder)


@pytest.mark.nightly
@pytest.mark.parametrize("page", RUNNING, ids=name_of)
def test_page_runs(page: Path, tmp_path: Path) -> None:
    ran("gcs-sim run triangle_line --seed 3 --out .", tmp_path)  # pages call it `flight.mcap`
    install_example(tmp_path)
    run_page(page, tmp_path)


def kinds() -> dict[str, str]:
    """The first command of each program and verb that the pages show, by those two words."""
    first: dict[str, str] = {}
    for command in (c for page in RUNNING for block in blocks(page) for c in runs(block)):
        first.setdefault(" ".join(command.split()[:2]), command)
    return first


def test_the_readme_runs_and_one_command_of_each_other_kind_on_its_flight(tmp_path: Path) -> None:
    readme = ROOT / "README.md"
    run_page(readme, tmp_path)
    done = {" ".join(c.split()[:2]) for block in blocks(readme) for c in runs(block)}
    others = {kind: command for kind, command in kinds().items() if kind not in done}
    assert len(others) > 5
    (tmp_path / "scenario.toml").write_text('lab = "lab.toml"\n')
    for command in others.values():
        ran(re.sub(r"\S+\.mcap", "runs/first/flight.mcap", command), tmp_path)

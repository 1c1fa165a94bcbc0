"""What the manual tells to run without hardware runs: README, a tutorial, a command of each kind; nightly, every page.

The tutorials run whole and in order, in one folder that is empty at first, as a new user has it.
"""

import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path

import pytest

from tests.docs.manual_pages import BASE_LAB, MANUAL, ROOT, Block, Labs, blocks, name_of, pages, shell_lines

RUN = ("gcs check", "gcs rules", "gcs-sim list", "gcs-sim check", "gcs-sim run", "gcs-log", "drone-agent --stages")
"""What is run: what needs neither drone, cameras, recording, browser nor another process, and ends by itself."""

RECORDINGS = ("--leader-csv", "gcs-log import", "gcs-log join")
"""What needs a recording of others, which the tests of the command make."""
RERUN = find_spec("rerun") is not None
"""Whether the extra `live` is installed, without which there is no blueprint for Rerun."""


def runs(block: Block) -> list[str]:
    if block.language != "sh":
        return []
    return [
        c
        for c in shell_lines(block)
        if c.startswith(RUN) and not any(word in c for word in RECORDINGS) and (RERUN or not c.endswith(".rbl"))
    ]


TUTORIALS = [MANUAL / "tutorials" / f"{name}.md" for name in ("first-flight", "lab-in-a-box", "analyse", "own-law")]
"""In the order of their index; `first-real-flight` needs drones."""
RUNNING = [page for page in pages() if page not in TUTORIALS and any(runs(block) for block in blocks(page))]


def environment(folder: Path) -> dict[str, str]:
    path = os.pathsep.join((str(ROOT / "examples" / "own_package"), str(folder / "installed")))
    return os.environ | {"PYTHONPATH": path}


def program_of(command: str) -> list[str]:
    program, *rest = shlex.split(command)
    return [str(Path(sys.executable).parent / program), *rest]


def ran(command: str, folder: Path, code: int = 0) -> None:
    done = subprocess.run(
        program_of(command), check=False, cwd=folder, capture_output=True, text=True, env=environment(folder)
    )
    assert done.returncode == code, f"{command}: {done.stdout[-2000:]}{done.stderr[-2000:]}"


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
            for word in shlex.split(re.sub(r"--(write|out) \S+", "", command)):  # all but what it writes
                if word.endswith(".toml") and not (folder / word).exists():
                    (folder / word).write_text(labs.text)
                if word.endswith(".mcap") and not (folder / word).exists():
                    shutil.copy(folder / "flight.mcap", folder / word)  # the reader's own flights
            ran(command, folder)


@pytest.mark.nightly
@pytest.mark.parametrize("page", RUNNING, ids=name_of)
def test_page_runs(page: Path, tmp_path: Path) -> None:
    ran("gcs-sim run triangle_line --seed 3 --out .", tmp_path)  # pages call it `flight.mcap`
    install_example(tmp_path)
    run_page(page, tmp_path)


DAEMONS = ("gcs-sim mocap-server", "gcs mocap", "drone-agent")
"""What runs until Ctrl-C, in a terminal of its own."""
CODES = {"gcs doctor lab.toml --still": 1}
"""Where a page says that a command ends with another code than 0."""
ELSEWHERE = ("export ", "pip install examples/own_package")
"""The programs are on the path of the tests, and the example package beside them."""


@contextmanager
def terminals(folder: Path) -> Iterator[Callable[[str], None]]:
    """Run each command that is typed; a daemon until another of its kind, or the end."""
    running: dict[str, subprocess.Popen[bytes]] = {}

    def end(kind: str) -> None:
        process = running.pop(kind)
        assert process.poll() is None, f"{kind} has ended: {(folder / f'{kind}.log').read_text()}"
        process.send_signal(signal.SIGINT)
        assert process.wait(60.0) in (0, 130), kind

    def type_in(command: str) -> None:
        kind = next((kind for kind in DAEMONS if command.startswith(kind)), None)
        if kind is None:
            ran(command.replace("make fly", "gcs-sim fly"), folder, CODES.get(command, 0))
            return
        kind = command if kind == "drone-agent" else kind
        if kind in running:
            end(kind)
        output = folder / f"{kind}.log"
        with output.open("wb") as file:
            running[kind] = subprocess.Popen(
                program_of(command), cwd=folder, stdout=file, stderr=file, env=environment(folder)
            )
        while not output.read_bytes():  # until it says something, as a person waits
            assert running[kind].poll() is None, command
            time.sleep(0.1)

    try:
        yield type_in
        for kind in reversed(list(running)):
            end(kind)
    finally:
        for process in running.values():
            process.kill()
            process.wait()


def walk(page: Path, folder: Path, labs: Labs) -> None:
    """Every command and all Python of a page in order; the files that other programs read are there at the end."""
    python, read = "", set()
    with terminals(folder) as type_in:
        for block in blocks(page):
            if block.language == "toml":
                labs.take(block)
                (folder / "lab.toml").write_text(labs.text)
            elif block.language == "python":
                python += block.text
                (folder / "page.py").write_text(python)
                ran("python page.py", folder)
            elif block.language == "sh":
                for command in shell_lines(block):
                    for word in shlex.split(command):  # a page that has another name for the lab as it is now
                        if word.endswith(".toml") and not (folder / word).exists():
                            (folder / word).write_text(labs.text)
                    if not command.startswith(ELSEWHERE):
                        type_in(command)
            else:
                read |= set(re.findall(r"runs/[\w./-]+", block.text))
    assert [file for file in sorted(read) if not (folder / file).exists()] == []


def test_the_tutorial_on_logs_runs(tmp_path: Path) -> None:
    walk(MANUAL / "tutorials" / "analyse.md", tmp_path, Labs({}))


@pytest.mark.nightly
@pytest.mark.processes
@pytest.mark.flights
@pytest.mark.timeout(1800)
def test_tutorials_run_in_order(tmp_path: Path) -> None:
    install_example(tmp_path)
    labs = Labs({})
    for page in TUTORIALS:
        walk(page, tmp_path, labs)


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

"""With `--json` every program prints JSON and nothing else there: what was asked for, or why it cannot be had."""

import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import typer

from gcs.cli.app import app as gcs_app
from sim.cli.app import app as sim_app
from sim.cli.log import app as log_app

BIN = Path(sys.executable).parent
pytestmark = pytest.mark.processes


def printed(*words: str, cwd: Path) -> tuple[int, Any]:
    done = subprocess.run([BIN / words[0], *words[1:], "--json"], cwd=cwd, capture_output=True, text=True, check=False)
    return done.returncode, json.loads(done.stdout)


@pytest.mark.parametrize(
    ("words", "word"),
    [
        (("gcs", "rules"), "rule-unseen"),
        (("gcs-sim", "list"), "triangle_line"),
        (("gcs-log", "layout"), "foxglove.json"),
        (("drone-agent", "--stages"), "OWN MODE"),
    ],
)
def test_what_was_asked_for_is_json(words: tuple[str, ...], word: str, tmp_path: Path) -> None:
    code, told = printed(*words, cwd=tmp_path)
    assert code == 0
    assert word in json.dumps(told)


def commands(command: Any, words: tuple[str, ...]) -> Iterator[tuple[tuple[str, ...], Any]]:
    """Every command of a program, with its words."""
    if not hasattr(command, "commands"):
        yield words, command
        return
    for name, part in command.commands.items():
        yield from commands(part, (*words, name))


def test_every_command_has_json_but_what_a_person_steers_or_watches() -> None:
    programs = {"gcs": gcs_app, "gcs-sim": sim_app, "gcs-log": log_app}
    without = [
        words
        for name, app in programs.items()
        for words, command in commands(typer.main.get_command(app), (name,))
        if not any("--json" in option.opts for option in command.params)
    ]
    assert sorted(without) == [("gcs", "fly", "gamepad"), ("gcs", "watch")]


@pytest.mark.parametrize(
    ("words", "error"),
    [
        (("gcs", "check"), "LAB.TOML"),
        (("gcs", "status", "--lab", "lab.toml"), "lab.toml: No such file or directory"),
        (("gcs", "mocap", "serve", "--linger", "x", "lab.toml"), "--linger"),
        (("gcs-sim", "run", "nothing"), "nothing: no such file, nor a shipped scenario"),
        (("gcs-sim", "run", "triangle_line", "--require", "rms=1"), "'rms=1' is not understood"),
        (("gcs-sim", "fly", "triangle_line", "--practice", "--watch"), "has no --watch, --json: `gcs run` has --page"),
        (("gcs-log", "report", "none.mcap"), "none.mcap"),
        (("gcs", "stop", "now"), "unexpected extra argument"),
        (("gcs-sim", "mocap-server", "--lab", "lab.toml"), "lab.toml"),
        (("gcs-sim", "paper", "--only", "nothing"), "nothing"),
        (("drone-agent", "--sysid", "900"), "sysid: "),
    ],
)
def test_so_is_what_is_wrong(words: tuple[str, ...], error: str, tmp_path: Path) -> None:
    code, told = printed(*words, cwd=tmp_path)
    assert code == 2
    assert error in told["error"]

"""Every shell line and TOML block that the manual and the README show is right: parsed by the programs themselves."""

import ast
import importlib
import importlib.util
import re
import shlex
import tomllib
from pathlib import Path
from typing import Any

import pytest
import typer

from formation.config import LabConfig
from gcs.finding import Grade
from gcs.lab.findings import findings_of, of_grade
from mavlink_formation.pytest_plugin import MOST
from tests.docs.manual_pages import BASE_LAB, ROOT, Labs, blocks, name_of, pages, shell_lines
from tools.reference import pieces
from wire.config_file import parse

FOREIGN = {
    "docker",
    "export",
    "ssh",
    "journalctl",
    "systemctl",
    "mavproxy.py",
    "mkdir",
    "rerun",
    "ros2",
    "zenoh-bridge-ros2dds",
}
"""Programs of other people: of them only the paths in this repository are checked."""
PATHS = re.compile(r"\b(?:contrib|examples|tests|tools|docs)/[\w./@-]+")


def parse_ours(words: list[str]) -> None:
    """Parse a command line of ours as the program itself does; nothing is run."""
    command: Any = pieces.program(words[0])
    path, rest = words[0], words[1:]
    while commands := getattr(command, "commands", None):
        if rest and rest[0] in ("--version", "--help"):
            return
        named = rest[0] if rest and rest[0] in commands else next(iter(commands)) if path != words[0] else None
        assert named is not None, f"{path} has no command {rest[:1]}"
        command, path, rest = commands[named], f"{path} {named}", rest[1:] if rest[:1] == [named] else rest
    command.make_context(path, list(rest))


def check_foreign(words: list[str]) -> None:
    """What can be known of a command that is not ours."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    match words:
        case ["make", target, *_]:
            assert re.search(rf"^{re.escape(target)}:", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE)
        case ["git", "clone", *_] | ["cd", _]:
            pass
        case ["pip", "install", *what]:
            for package in what:
                extra = re.fullmatch(r"(?:mavlink-formation|\.)\[(\w+)\]", package)
                assert extra[1] in project["optional-dependencies"] if extra else (ROOT / package).exists(), package
        case ["pytest", *options]:
            assert all(not option.startswith("--") or option in MOST for option in options)
        case ["python", "-m", module, *options]:
            app = typer.Typer()
            app.command()(importlib.import_module(module).main)
            typer.main.get_command(app).make_context(module, options)
        case ["python", script, *_]:
            assert (ROOT / script).is_file(), script
        case ["sudo", program, *rest] if program.endswith("/pip"):
            check_foreign(["pip", *rest])
        case ["sudo", program, *rest] if program.endswith("/gcs"):
            parse_ours(["gcs", *rest])
        case ["sudo", program, *_]:
            assert program in {"cp", "python3", "mkdir", "systemctl", "udevadm", "ufw", "useradd", "usermod"}
        case [program, *_]:
            assert program in FOREIGN, f"{program}: neither ours nor known"
    for path in PATHS.findall(" ".join(words)):
        assert (ROOT / path).exists(), path


@pytest.mark.parametrize("page", pages(), ids=name_of)
def test_shell_lines_parse(page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    for block in blocks(page):
        assert block.language != "bash", "use sh"
        if block.language != "sh":
            continue
        for command in shell_lines(block):
            words = shlex.split(command)
            for word in words:
                if word.endswith((".toml", ".mcap")):
                    Path(word).parent.mkdir(parents=True, exist_ok=True)
                    Path(word).touch()
            if words[0] in pieces.PROGRAMS:
                parse_ours(words)
            else:
                check_foreign(words)


@pytest.mark.parametrize("page", pages(), ids=name_of)
def test_toml_blocks_pass_the_check(page: Path) -> None:
    labs = Labs(BASE_LAB)
    for block in blocks(page):
        if block.language != "toml":
            continue
        labs.take(block)
        config = parse(labs.lab, LabConfig, source=name_of(page))
        assert of_grade(findings_of(config), Grade.FAIL) == []


@pytest.mark.parametrize("page", pages(), ids=name_of)
def test_python_blocks_import_what_exists(page: Path) -> None:
    for block in blocks(page):
        if block.language != "python":
            continue
        for node in ast.walk(ast.parse(block.text)):
            if isinstance(node, ast.ImportFrom):
                module = importlib.import_module(str(node.module))
                assert all(
                    hasattr(module, a.name) or importlib.util.find_spec(f"{node.module}.{a.name}") for a in node.names
                )
            elif isinstance(node, ast.Import):
                assert all(importlib.util.find_spec(a.name) for a in node.names)

"""The image has every package that the wheel has; what it runs are commands of ours."""

import re
import tomllib
from pathlib import Path

from typer.testing import CliRunner

from gcs.cli.app import app as gcs
from sim.cli.app import app as gcs_sim

ROOT = Path(__file__).parents[2]
CONTAINER = ROOT / "contrib" / "container"
PROGRAMS = {"gcs": gcs, "gcs-sim": gcs_sim}


def test_the_image_is_made_of_every_package() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    packages = project["tool"]["hatch"]["build"]["targets"]["wheel"]["packages"]
    taken = (CONTAINER / "Containerfile.dockerignore").read_text().splitlines()
    assert not {f"!{package}" for package in packages} - set(taken)


def test_its_services_run_commands_that_there_are() -> None:
    found = re.findall(r"command: \[(.*)\]", (CONTAINER / "compose.yaml").read_text())
    commands = [re.findall(r"[^\s,\"]+", words) for words in found]
    assert len(commands) == 3
    for program, *words in commands:
        known = CliRunner().invoke(PROGRAMS[program], [words[0], "--help"])
        assert known.exit_code == 0
        assert all(word in known.output for word in words if word.startswith("--"))

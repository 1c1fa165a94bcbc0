"""What all commands of `gcs` share: options, exit codes, reading the lab file, failing with a word."""

from pathlib import Path
from typing import Annotated, NoReturn

import typer
from rich.console import Console

from formation.config import LabConfig
from wire.config_file import ConfigError, load

REFUSED, NOT_RIGHT, NO_GROUND = 1, 2, 3

Name = Annotated[str, typer.Option("--name", help="Which ground of the lab.")]
Json = Annotated[bool, typer.Option("--json", help="Print JSON, for scripts.")]
LabFile = Annotated[Path, typer.Argument(metavar="LAB.TOML", help="The lab: bodies, drones, limits, links, mocap.")]


def configuration(path: Path) -> LabConfig:
    """The lab in the file; ends the program where it is not right."""
    try:
        return load(path, LabConfig)
    except ConfigError as error:
        fail(str(error), NOT_RIGHT)


def fail(text: str, code: int) -> NoReturn:
    """End the program with a word and an exit code."""
    Console(stderr=True).print(f"gcs: {text}", style="red", highlight=False, markup=False, soft_wrap=True)
    raise typer.Exit(code)

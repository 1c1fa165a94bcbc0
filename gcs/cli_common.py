"""What all commands of `gcs` share: options, exit codes, reading the lab file, failing with a word."""

import json
from pathlib import Path
from typing import Annotated, NoReturn

import typer
from rich.console import Console

from formation.config import LabConfig
from formation.messages import Event, Severity
from wire.config_file import ConfigError, load

REFUSED, NOT_RIGHT, NO_GROUND = 1, 2, 3

STYLES = {
    Severity.WARNING: "yellow",
    Severity.ERROR: "red",
    Severity.CRITICAL: "bold red",
    Severity.EMERGENCY: "bold red",
}

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


def tell(event: Event) -> None:
    """One line on the terminal for people."""
    style = STYLES.get(event.severity, "")
    console = Console(stderr=True)
    console.print(f"{event.source}: {event.text}", style=style, highlight=False, markup=False, soft_wrap=True)


def tell_json(event: Event) -> None:
    """One line of JSON for scripts."""
    print(json.dumps({"severity": event.severity.name, "source": event.source, "text": event.text}), flush=True)

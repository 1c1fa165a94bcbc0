"""What all commands of `gcs` share: options, exit codes, reading the lab file, ending with an error."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NoReturn

import typer

from wire.errors import ConfigError
from wire.process.exit_codes import NO_GROUND as NO_GROUND
from wire.process.exit_codes import NOT_LANDED as NOT_LANDED
from wire.process.exit_codes import NOT_RIGHT as NOT_RIGHT
from wire.process.exit_codes import REJECTED as REJECTED
from wire.process.program import print_json_error

if TYPE_CHECKING:
    from formation.config import LabConfig
    from formation.messages import Event

COLOURS = {"WARNING": "yellow", "ERROR": "red", "CRITICAL": "bright_red", "EMERGENCY": "bright_red"}

Name = Annotated[str, typer.Option("--name", help="Which ground of the lab.")]
Speed = Annotated[float, typer.Option(min=0.01, max=1.0, hidden=True)]
Json = Annotated[bool, typer.Option("--json", help="Print JSON, for scripts.")]
Insecure = Annotated[
    bool, typer.Option("--insecure", help="Simulation only: open links to other machines without any keys.")
]
LabFile = Annotated[Path, typer.Argument(metavar="LAB.TOML", help="The lab: bodies, drones, limits, links, mocap.")]


def configuration(path: Path) -> "LabConfig":
    """The lab in the file; ends the program where it is not right."""
    from formation.config import LabConfig
    from wire.config_file import load

    try:
        return load(path, LabConfig)
    except ConfigError as error:
        fail(str(error), NOT_RIGHT)


def print_error(text: str) -> None:
    """Print a line on standard error; red on a terminal."""
    typer.secho(text, fg="red", err=True)


def fail(text: str, code: int) -> NoReturn:
    """Print an error and end the program with an exit code."""
    print_json_error(text)
    print_error(f"gcs: {text}")
    raise typer.Exit(code)


def print_event(event: "Event") -> None:
    """Print one line on standard error, for people."""
    typer.secho(f"{event.source}: {event.text}", fg=COLOURS.get(event.severity.name), err=True)


def print_event_json(event: "Event") -> None:
    """Print one line of JSON on standard output, for scripts."""
    print(json.dumps({"severity": event.severity.name, "source": event.source, "text": event.text}), flush=True)

"""`gcs service`: systemd units for this lab, written and explained."""

import json
import os
import pwd
from pathlib import Path
from typing import Annotated

import typer

from wire.errors import ConfigError
from wire.process.program import Json, LabFile, configuration, fail
from wire.process.system import NOT_RIGHT, REJECTED

app = typer.Typer(no_args_is_help=True, rich_markup_mode=None, help="Run this lab's programs as systemd services.")
UNITS = Path("/etc/systemd/system")


@app.callback()
def _group() -> None:
    """Keeps `install` a command of its own."""


@app.command()
def install(
    lab: LabFile,
    bridge: Annotated[
        list[str] | None,
        typer.Option(metavar="BODY=AUTOPILOT", help="The guard of that drone alone: left=serial:/dev/ttyACM0:921600."),
    ] = None,
    user: Annotated[str, typer.Option(help="Whom the services run as; the owner of the lab file if not given.")] = "",
    to: Annotated[Path, typer.Option(metavar="DIR", help="Folder for the units.")] = UNITS,
    as_json: Json = False,
) -> None:
    """Write the units of ground and mocap process, or with --bridge of a drone's guard, and say how to start them."""
    from gcs.service import bridge_unit, ground_units

    config, file = configuration(lab), lab.absolute()
    user = user or _owner(file)
    try:
        pairs = [pair.partition("=") for pair in bridge or ()]
        units = [bridge_unit(file, config, user, body, autopilot) for body, _, autopilot in pairs]
    except ConfigError as error:
        fail(str(error), NOT_RIGHT)
    units = units or list(ground_units(file, config, user))
    try:
        for unit in units:
            (to / unit.name).write_text(unit.text, encoding="utf-8")
    except OSError as error:
        root = "" if os.geteuid() == 0 or to != UNITS else " (run it by sudo, or give --to)"
        fail(f"{error.filename}: {error.strerror}{root}", REJECTED)
    if as_json:
        print(json.dumps({"user": user, "units": [str(to / unit.name) for unit in units]}))
        return
    print(f"as user {user}; logs of flights go to /var/lib/mavlink-formation/runs")
    for unit in units:
        print(f"{to / unit.name}: {unit.about}")
    print("\nnow\n  sudo systemctl daemon-reload")
    for unit in units:
        print(f"  sudo systemctl {'enable --now' if unit.at_boot else 'start'} {unit.name}")
    print(f"  journalctl --follow --unit '{units[-1].name}'")


def _owner(file: Path) -> str:
    """Who owns the lab file; ends the program where that is root, who flies nothing."""
    uid = file.stat().st_uid
    if uid == 0:
        fail(f"{file} belongs to root: say with --user whom the services run as", NOT_RIGHT)
    return pwd.getpwuid(uid).pw_name

"""`gcs service`: systemd units for this installation and this lab: what is started, as whom, what it may touch.

The units are the files in `units`, in which names are filled in. Each says when it is ready and that it goes on
(wire.process.daemon). The ground is in no boot: a person starts it and watches it. A unit finds everything read-only
but its cache, its state and the devices of its groups.
"""

import json
import os
import pwd
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from string import Template
from typing import TYPE_CHECKING, Annotated

import typer

from formation.names import meant, unknown
from wire.errors import ConfigError
from wire.files import demand_absent, write_edited
from wire.process.program import Json, LabFile, Overwrite, configuration, fail
from wire.process.system import NOT_RIGHT, REJECTED, python_command

if TYPE_CHECKING:
    from formation.config import LabConfig

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
    overwrite: Overwrite = False,
    as_json: Json = False,
) -> None:
    """Write the units of ground and mocap process, or with --bridge of a drone's guard, and say how to start them."""
    config, file = configuration(lab), lab.absolute()
    user = _known_user(user) if user else _owner(file)
    try:
        pairs = [pair.partition("=") for pair in bridge or ()]
        units = [bridge_unit(file, config, user, body, autopilot) for body, _, autopilot in pairs]
    except ConfigError as error:
        fail(str(error), NOT_RIGHT)
    units = units or list(ground_units(file, config, user))
    try:
        for unit in units:
            demand_absent(to / unit.name, overwrite)
        for unit in units:
            write_edited(to / unit.name, unit.text, overwrite)
    except ConfigError as error:
        fail(str(error), NOT_RIGHT)
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
        print(f"  sudo systemctl {'enable --now' if unit.is_at_boot else 'start'} {unit.name}")
    print(f"  journalctl --follow --unit '{units[-1].name}'")


def _owner(file: Path) -> str:
    """Who owns the lab file; ends the program where that is root, who flies nothing."""
    uid = file.stat().st_uid
    if uid == 0:
        fail(f"{file} belongs to root: say with --user whom the services run as", NOT_RIGHT)
    try:
        return pwd.getpwuid(uid).pw_name
    except KeyError:
        fail(f"{file} belongs to user number {uid}, who has no name here: say with --user whom they run as", NOT_RIGHT)


def _known_user(user: str) -> str:
    """The user; ends the program where this computer has none of that name or number."""
    try:
        return pwd.getpwuid(int(user)).pw_name if user.isdecimal() else pwd.getpwnam(user).pw_name
    except (KeyError, OverflowError):
        near = meant(user, [each.pw_name for each in pwd.getpwall()])
        fail(f"--user: this computer has no user {user!r}{near}", NOT_RIGHT)


@dataclass(frozen=True, slots=True)
class Unit:
    """One file for /etc/systemd/system."""

    name: str
    text: str

    @property
    def about(self) -> str:
        """Its first line: what it is for."""
        return self.text.partition("\n")[0].removeprefix("# ")

    @property
    def is_at_boot(self) -> bool:
        """Whether it is one that is enabled."""
        return "[Install]" in self.text


def ground_units(lab_file: Path, config: "LabConfig", user: str) -> tuple[Unit, ...]:
    """The mocap process that outlives every ground, and the ground; lab_file: absolute."""
    mocap = _unit("mocap", "mocap", ("gcs", "mocap", str(lab_file)), lab=config.name, user=user)
    ground = _unit(
        "ground", "ground", ("gcs", "run", str(lab_file)), lab=config.name, user=user,
        mocap=mocap.name, groups="" if config.operator.stop_button is None else "input",
    )  # fmt: skip
    return mocap, ground


def bridge_unit(lab_file: Path, config: "LabConfig", user: str, body: str, autopilot: str) -> Unit:
    """The guard beside a drone's autopilot, `serial:DEV:BAUD` or `udp:HOST:PORT`; ConfigError where there is none."""
    drones = [vehicle.body for vehicle in config.vehicles if vehicle.sysid is not None]
    if body not in drones:
        raise ConfigError([f"--bridge: none of the lab's drones is {unknown(body, drones)}"])
    from wire.transport.serial_link import device_and_baud  # MAVLink's parser, which `gcs stop` does without
    from wire.transport.udp_bus import direct_address

    try:
        device_and_baud(autopilot) if autopilot.startswith("serial:") else direct_address(autopilot)
    except ValueError as error:
        forms = "BODY=serial:DEV:BAUD, BODY=udp:HOST:PORT or BODY=udpin:HOST:PORT"
        raise ConfigError([f"--bridge: {body}={autopilot}: {forms} is wanted"]) from error
    command = ("drone_agent", "--lab", str(lab_file), "--body", body, "--bridge", autopilot)
    return _unit("bridge", f"bridge-{body}", command, lab=config.name, user=user, body=body, autopilot=autopilot)


def _unit(file: str, name: str, program: Sequence[str], **names: str) -> Unit:
    """A unit of the folder beside this file, and what every unit has, with its names filled in."""
    folder = Path(__file__).with_name("units")
    text = "".join((folder / part).read_text(encoding="utf-8") for part in (f"{file}.service", "every.conf"))
    command = " ".join(map(_quoted, python_command(*program)))
    return Unit(f"mavlink-formation-{name}.service", Template(text).substitute(names, command=command))


def _quoted(word: str) -> str:
    """A word of ExecStart: systemd replaces what begins with % and $, and cuts at blanks."""
    escaped = word.replace("\\", r"\\").replace('"', r"\"").replace("%", "%%").replace("$", "$$")
    return f'"{escaped}"' if set(escaped) & set(" '\"\\;") else escaped

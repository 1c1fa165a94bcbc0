"""`gcs service`: systemd units for this installation and this lab: what is started, as whom, what it may touch.

Each says when it is ready and that it goes on (wire.process.daemon). The ground is in no boot: a person starts it and
watches it. A unit finds everything read-only but its cache, its state and the devices of its groups.
"""

import json
import os
import pwd
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
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
        print(f"  sudo systemctl {'enable --now' if unit.at_boot else 'start'} {unit.name}")
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


STATE = "mavlink-formation"
"""Folder under /var/lib, where the ground's logs go, and under /var/cache, for compiled kernels."""


@dataclass(frozen=True, slots=True)
class Unit:
    """One file for /etc/systemd/system. at_boot: whether it is one that is enabled."""

    name: str
    about: str
    at_boot: bool
    text: str


def ground_units(lab_file: Path, config: "LabConfig", user: str) -> tuple[Unit, ...]:
    """The mocap process that outlives every ground, where the lab has cameras, and the ground; lab_file: absolute."""
    has_cameras = config.mocap.source != "mavlink"
    mocap = Unit(
        f"{STATE}-mocap.service",
        "the mocap process: at boot, so that poses reach the drones whatever becomes of the ground",
        at_boot=True,
        text=_text(
            f"mocap process of lab {config.name}", python_command("gcs", "mocap", str(lab_file)), user, _RESTARTED
        )
        + _INSTALL,
    )
    # Its end lands the swarm, which has a minute; one that hangs is ended, and every guard lands its drone.
    lines = ["WatchdogSec=2", "TimeoutStopSec=90", f"StateDirectory={STATE}", f"WorkingDirectory=%S/{STATE}"]
    if config.operator.stop_button is not None:
        lines.append("SupplementaryGroups=input")
    command = python_command("gcs", "run", str(lab_file))
    ground = Unit(
        f"{STATE}-ground.service",
        "the ground: started by hand, ready when frames and drones are heard; a stop lands the swarm first",
        at_boot=False,
        text=_text(f"ground of lab {config.name}", command, user, lines, (mocap.name,) if has_cameras else ()),
    )
    return (mocap, ground) if has_cameras else (ground,)


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
    command = python_command("drone_agent", "--lab", str(lab_file), "--body", body, "--bridge", autopilot)
    # After a crash in flight the autopilot's own time-out acts first.
    lines = (*_RESTARTED, "SupplementaryGroups=dialout")
    return Unit(
        f"{STATE}-bridge-{body}.service",
        f"the guard of {body}, at {autopilot}: at boot",
        at_boot=True,
        text=_text(f"guard of {body}, lab {config.name}", command, user, lines) + _INSTALL,
    )


_RESTARTED = ("WatchdogSec=5", "Restart=on-failure", "RestartSec=1")
_UNIT = """\
[Unit]
Description=mavlink-formation: {description}
After=network-online.target
Wants={wants}

[Service]
Type=notify
ExecStart={command}
User={user}
{lines}
# The first start compiles; `systemctl status` says what is waited for.
TimeoutStartSec=infinity
# Late setpoints are dropped: this goes before other programs.
Nice=-10
LimitNICE=-10
NoNewPrivileges=yes
ProtectSystem=strict
ProtectHome=read-only
PrivateTmp=yes
# Kernels that no cache beside the program has are compiled at the first start.
CacheDirectory={state}
Environment=XDG_CACHE_HOME=%C/{state}
CapabilityBoundingSet=
RestrictAddressFamilies=AF_UNIX AF_INET AF_INET6 AF_NETLINK
SystemCallFilter=@system-service
SystemCallErrorNumber=EPERM
SystemCallArchitectures=native
RestrictNamespaces=yes
RestrictSUIDSGID=yes
LockPersonality=yes
ProtectControlGroups=yes
ProtectKernelLogs=yes
ProtectKernelModules=yes
ProtectKernelTunables=yes
"""
_INSTALL = """
[Install]
WantedBy=multi-user.target
"""


def _text(description: str, command: Sequence[str], user: str, lines: Sequence[str], wants: Sequence[str] = ()) -> str:
    return _UNIT.format(
        description=description,
        command=" ".join(map(_quoted, command)),
        user=user,
        lines="\n".join(lines),
        wants=" ".join(("network-online.target", *wants)),
        state=STATE,
    )


def _quoted(word: str) -> str:
    """A word of ExecStart: systemd replaces what begins with % and $, and cuts at blanks."""
    escaped = word.replace("\\", r"\\").replace('"', r"\"").replace("%", "%%").replace("$", "$$")
    return f'"{escaped}"' if set(escaped) & set(" '\"\\;") else escaped

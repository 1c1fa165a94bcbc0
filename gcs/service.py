"""systemd's units for this installation and this lab: what is started, as whom, and what it may touch. Writes nothing.

Each says when it is ready and that it goes on (wire.process.service_manager). The ground is in no boot: a person starts
it and watches it. A unit finds everything read-only but its cache, its state and the devices of its groups.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from formation.config import LabConfig
from wire.errors import ConfigError
from wire.process.system import python_command

STATE = "mavlink-formation"
"""Folder under /var/lib, where the ground's logs go, and under /var/cache, for compiled kernels."""


@dataclass(frozen=True, slots=True)
class Unit:
    """One file for /etc/systemd/system. at_boot: whether it is one that is enabled."""

    name: str
    about: str
    at_boot: bool
    text: str


def ground_units(lab_file: Path, config: LabConfig, user: str) -> tuple[Unit, ...]:
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


def bridge_unit(lab_file: Path, config: LabConfig, user: str, body: str, autopilot: str) -> Unit:
    """The guard beside a drone's autopilot, `serial:DEV:BAUD` or `udp:HOST:PORT`; ConfigError where there is none."""
    drones = [vehicle.body for vehicle in config.vehicles if vehicle.sysid is not None]
    if body not in drones:
        raise ConfigError([f"--bridge: {body!r} is none of the lab's drones: {', '.join(drones)}"])
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

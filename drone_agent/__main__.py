"""`drone-agent`: a simulated quadcopter that speaks MAVLink, or several, as a process."""

import json
import sys
from collections.abc import Coroutine, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from drone_agent.guard.stages import table_markdown
from formation.names import meant
from mavlink_formation.installation import install_command
from wire.clock import Clock
from wire.errors import ConfigError
from wire.process.daemon import STARVED, StarvedError
from wire.process.output import dropping_output
from wire.process.program import (
    SingleProgram,
    Version,
    bodies_of,
    lab_near,
    print_event,
    print_event_json,
    print_json_error,
    starting,
    with_options,
)
from wire.text import rows

if TYPE_CHECKING:
    from drone_agent.crazyflie.core import CrazyflieConfig
    from drone_agent.guard.config import GuardConfig
    from wire.process.daemon import EventSink

app = typer.Typer(pretty_exceptions_enable=False, rich_markup_mode=None)

EPILOG = (
    "`drone-agent --sysid 1 --link udp` is a drone that any MAVLink client can fly. All else is a key of the file. "
    "Exit codes: 0 done; 1 a port or a device cannot be had; 2 something given is not right; "
    "3 starved, the simulation came too late to be one."
)


def _bodies(incomplete: str) -> list[str]:
    """Names for the Tab key: the vehicles of `lab.toml` here."""
    return starting(bodies_of(lab_near(None)), incomplete)


@dataclass(frozen=True, slots=True)
class Options:
    """The options of the command line; None where the file, or the default, says it."""

    config: Annotated[
        list[Path] | None,
        typer.Option(help="TOML file; other options win over it. Given again: one more drone in this process."),
    ] = None
    sysid: Annotated[int | None, typer.Option(help="MAVLink system, 1..250; 1 if not given.")] = None
    lab: Annotated[
        str | None,
        typer.Option(
            help="The lab's file, LAB.TOML: with --body it says the rest. Or its name, the root of its keys on the bus."
        ),
    ] = None
    body: Annotated[str | None, typer.Option(help="The mocap's name of this drone.", autocompletion=_bodies)] = None
    bridge: Annotated[
        str | None,
        typer.Option(
            help="Bridge to a real autopilot: udp:HOST:PORT, udpin:HOST:PORT or serial:DEV:BAUD; or to a Crazyflie: "
            "radio://DONGLE/CHANNEL/RATE/ADDRESS or udp://HOST:PORT."
        ),
    ] = None
    link: Annotated[
        str | None, typer.Option(help="zenoh (if not given), or udp: from port 14580 + sysid to 14540 + sysid.")
    ] = None
    keys: Annotated[Path | None, typer.Option(help="Folder of the keys that `gcs keys install` wrote.")] = None
    insecure: Annotated[
        bool | None, typer.Option("--insecure", help="Simulation only: open links to other machines without any keys.")
    ] = None
    speed: Annotated[float, typer.Option(min=0.01, max=1.0, hidden=True)] = 1.0
    stages: Annotated[bool, typer.Option("--stages", help="Print the table of stages, and do nothing else.")] = False
    as_json: Annotated[bool, typer.Option("--json", help="Events and errors as lines of JSON, on standard output.")] = (
        False
    )
    version: Version = False


_NOW_KEYS = {
    "--autopilot": "autopilot",
    "--host": "link.host",
    "--param": "parameters",
    "--personality": "autopilot",
    "--pose": "pose",
    "--profile": "profile",
    "--stale-land": "stale_land_s",
    "--stale-setpoint": "stale_setpoint_s",
    "--start": "start_lab_m",
    "--truth": "truth_rate_hz",
    "--yaw": "start_yaw_rad",
    "--zenoh-connect": "link.zenoh_connect",
}
"""Options of version 0.1, and the keys that say it now."""


class _Program(SingleProgram):
    """The command line; an option that has become a key is refused with the key."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Refuse what version 0.1 took, then parse."""
        for word in args:
            if (option := word.partition("=")[0]) in _NOW_KEYS:
                ctx.fail(f"{option} is now the key {_NOW_KEYS[option]} of the file that --config names")
        return super().parse_args(ctx, args)


@app.command(cls=_Program, epilog=EPILOG)
@with_options(Options)
def fly(options: Options) -> None:
    """Be a simulated drone that speaks MAVLink, or with --bridge stand beside a real one; until Ctrl-C."""
    if options.stages:
        typer.echo(json.dumps(rows(table_markdown())) if options.as_json else table_markdown())
    else:
        _fly(options)


@dropping_output()
def _fly(options: Options) -> None:
    import uvloop

    report = print_event_json if options.as_json else print_event
    try:
        drones = [_config(options, file) for file in options.config or (None,)]
        uvloop.run(_process(drones, report, Clock(options.speed)))
    except ConfigError as error:
        _fail(str(error), 2)
    except StarvedError as error:
        _fail(f"drone-agent: {error}", STARVED)
    except OSError as error:
        _fail(f"drone-agent: {error.strerror or error}", 1)


def _process(drones: "list[GuardConfig]", report: "EventSink", clock: Clock) -> Coroutine[Any, Any, None]:
    """The process's work: a bridge or simulated drones. Only the one that it is is imported; ConfigError."""
    if any("bridge" in drone.model_fields_set for drone in drones):
        from drone_agent.bridge import BridgeConfig, run_bridge
        from drone_agent.crazyflie.core import CrazyflieConfig

        match drones:
            case [BridgeConfig() as bridge]:
                return run_bridge(bridge, report, clock)
        crazyflies = [drone for drone in drones if isinstance(drone, CrazyflieConfig)]
        if len(crazyflies) == len(drones):
            return _crazyflies(crazyflies, report, clock)
        raise ConfigError(["drone-agent: bridge: a bridge is a process of its own"])
    from drone_agent.config import SimulatedDroneConfig
    from drone_agent.daemon import run

    agents = [drone for drone in drones if isinstance(drone, SimulatedDroneConfig)]
    _check_together(agents)
    return run(agents, report, clock)


def _crazyflies(configs: "list[CrazyflieConfig]", report: "EventSink", clock: Clock) -> Coroutine[Any, Any, None]:
    """Those of one radio, which cflib drives; ConfigError where it is not installed."""
    _check_together(configs)
    try:
        from drone_agent.crazyflie.bridge import run_crazyflies
    except ModuleNotFoundError as error:
        if error.name is None or error.name.partition(".")[0] != "cflib":
            raise
        raise ConfigError([f"drone-agent: bridge: cflib is not here: {install_command('crazyflie')}"]) from error
    return run_crazyflies(configs, report, clock)


def _config(options: Options, file: Path | None) -> "GuardConfig":
    """The file's configuration with the options given laid over it; ConfigError, a line of the file's with its number.

    Only the model that it is is imported.
    """
    from wire.config_file import parse, parse_read
    from wire.files import read_toml

    values = {} if file is None else read_toml(file)
    if options.lab is not None and options.lab.endswith(".toml"):
        values |= _of_lab(Path(options.lab), options.body or values.get("body"))
        options = replace(options, lab=None)
        if options.bridge is None and "bridge" not in values:
            values.setdefault("pose", "mocap")  # in a lab it knows its position from the cameras alone
    options_by_key = {key: getattr(options, key) for key in ("sysid", "lab", "body", "bridge", "keys", "insecure")}
    values |= {key: value for key, value in options_by_key.items() if value is not None}
    table = values.get("link", {})
    if options.link is not None and isinstance(table, dict):
        values["link"] = table | {"kind": options.link}
    kind: type[GuardConfig]
    if "://" in str(values.get("bridge", "")):
        from drone_agent.crazyflie.core import CrazyflieConfig as kind
    elif "bridge" in values:
        from drone_agent.bridge import BridgeConfig as kind
    else:
        from drone_agent.config import SimulatedDroneConfig as kind
    return parse(values, kind, source="drone-agent") if file is None else parse_read(values, kind, file)


def _of_lab(file: Path, body: str | None) -> dict[str, Any]:
    """What a lab file says of one of its drones and of the bus; ConfigError."""
    from formation.config import LabConfig
    from wire.config_file import parse
    from wire.files import read_toml
    from wire.security.private_keys import keys_folder

    lab = parse(read_toml(file), LabConfig, source=str(file))  # its own law is the ground's, and need not be here
    drones = {vehicle.body: vehicle for vehicle in lab.vehicles if vehicle.sysid is not None}
    drone = drones.get(body or "")
    if drone is None:
        raise ConfigError(
            [f"{file}: --body {body or 'is missing'}{meant(body or '', drones)}: its drones are {', '.join(drones)}"]
        )
    keys = {} if lab.security is None else {"keys": keys_folder(lab.security.keys, file)}
    everywhere, addresses = "/0.0.0.0:", () if lab.security is None else lab.security.addresses
    # The ground listens at every address of its computer; here it is reached by those that the lab file names.
    bus = [e.replace(everywhere, f"/{a}:") for e in lab.link.joined.zenoh_connect for a in addresses or ("0.0.0.0",)]
    return keys | {
        "sysid": drone.sysid,
        "lab": lab.name,
        "body": drone.body,
        "profile": drone.profile,
        "profiles": [profile.model_dump() for profile in lab.profiles],
        "origin": lab.origin,
        "link": lab.link.joined.model_dump() | {"zenoh_connect": list(dict.fromkeys(bus))},
    }


def _check_together(agents: "Sequence[GuardConfig]") -> None:
    """ConfigError where one process cannot be all of them: they share its bus, and nothing else."""
    if len(agents) < 2:
        return
    numbers = [agent.sysid for agent in agents]
    for wrong, text in (
        (len(set(numbers)) < len(numbers), "sysid: each drone needs its own"),
        (any(agent.keys is not None for agent in agents), "keys: a drone with keys is a process of its own"),
        (len({agent.lab for agent in agents}) > 1, "lab: the drones of one process are in one lab"),
    ):
        if wrong:
            raise ConfigError([f"drone-agent: {text}"])


def _fail(text: str, code: int) -> None:
    print_json_error(text)
    sys.stderr.write(f"{text}\n")
    raise typer.Exit(code)


if __name__ == "__main__":
    app()

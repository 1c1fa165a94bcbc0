"""`drone-agent`: a simulated quadcopter that speaks MAVLink, or several, as a process."""

import json
import sys
from collections.abc import Coroutine
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from drone_agent.guard.stages import table_markdown
from formation.names import meant
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
    from drone_agent.config import SimulatedDroneConfig
    from drone_agent.guard.config import GuardConfig
    from wire.process.daemon import EventSink

app = typer.Typer(pretty_exceptions_enable=False, rich_markup_mode=None)

EPILOG = (
    "`drone-agent --sysid 1 --link udp` is a drone that any MAVLink client can fly. "
    "Exit codes: 0 done; 1 a port or a device cannot be had; 2 something given is not right; "
    "3 starved, the simulation came too late to be one."
)


def _bodies(incomplete: str) -> list[str]:
    """Names for the Tab key: the vehicles of `lab.toml` here."""
    return starting(bodies_of(lab_near(None)), incomplete)


def _profiles(incomplete: str) -> list[str]:
    """Names for the Tab key: the shipped vehicles."""
    from formation.vehicle.profile import PROFILES

    return starting(PROFILES, incomplete)


@dataclass(frozen=True, slots=True)
class Options:
    """The options of the command line; None where the file, or the default, says it."""

    sysid: Annotated[int | None, typer.Option(help="MAVLink system, 1..250; 1 if not given.")] = None
    link: Annotated[
        str | None, typer.Option(help="zenoh (if not given), or udp: from port 14580 + sysid to 14540 + sysid.")
    ] = None
    config: Annotated[
        list[Path] | None,
        typer.Option(help="TOML file; other options win over it. Given again: one more drone in this process."),
    ] = None
    lab: Annotated[
        str | None,
        typer.Option(
            help="The lab's file, LAB.TOML: with --body it says the rest. Or its name, the root of its keys on the bus."
        ),
    ] = None
    body: Annotated[str | None, typer.Option(help="The mocap's name of this drone.", autocompletion=_bodies)] = None
    autopilot: Annotated[
        str | None, typer.Option("--autopilot", "--personality", help="px4 (if not given) or ardupilot.")
    ] = None
    bridge: Annotated[
        str | None, typer.Option(help="Bridge to a real autopilot: udp:HOST:PORT, udpin:HOST:PORT or serial:DEV:BAUD.")
    ] = None
    pose: Annotated[
        str | None, typer.Option(help="own (simulated positioning, if not given) or mocap (external only).")
    ] = None
    profile: Annotated[
        str | None,
        typer.Option(
            help="Vehicle: paper_40g (if not given) or another shipped profile; a wrong one is answered by all.",
            autocompletion=_profiles,
        ),
    ] = None
    start: Annotated[str | None, typer.Option(help="Where it stands: x,y,z in lab metres.")] = None
    yaw: Annotated[float | None, typer.Option(help="Where it faces, rad about lab z.")] = None
    truth: Annotated[
        float | None,
        typer.Option(help="Publish the true pose this often, Hz, for `gcs-sim mocap`; never if not given."),
    ] = None
    host: Annotated[str | None, typer.Option(help="The ground's host (udp).")] = None
    zenoh_connect: Annotated[str | None, typer.Option(help="Endpoint of the bus, tcp/HOST:PORT.")] = None
    keys: Annotated[Path | None, typer.Option(help="Folder of the keys that `gcs keys install` wrote.")] = None
    insecure: Annotated[
        bool | None, typer.Option("--insecure", help="Simulation only: open links to other machines without any keys.")
    ] = None
    stale_setpoint: Annotated[
        float | None, typer.Option(help="Level after this silence, s; 0.1 if not given, 0: never.")
    ] = None
    stale_land: Annotated[float | None, typer.Option(help="Land this long after levelling, s.")] = None
    param: Annotated[list[str] | None, typer.Option(help="NAME=VALUE, as often as needed.")] = None
    speed: Annotated[float, typer.Option(min=0.01, max=1.0, hidden=True)] = 1.0
    stages: Annotated[bool, typer.Option("--stages", help="Print the table of stages, and do nothing else.")] = False
    as_json: Annotated[bool, typer.Option("--json", help="Events and errors as lines of JSON, on standard output.")] = (
        False
    )
    version: Version = False


@app.command(cls=SingleProgram, epilog=EPILOG)
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

        match drones:
            case [BridgeConfig() as bridge]:
                return run_bridge(bridge, report, clock)
        raise ConfigError(["drone-agent: bridge: a bridge is a process of its own"])
    from drone_agent.config import SimulatedDroneConfig
    from drone_agent.daemon import run

    agents = [drone for drone in drones if isinstance(drone, SimulatedDroneConfig)]
    if len(agents) > 1:
        _check_together(agents)
    return run(agents, report, clock)


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
    for key, value in _laid_over(options).items():
        if isinstance(value, dict):
            table = values.get(key, {})
            values |= {key: table | value} if value and isinstance(table, dict) else {}
        elif value is not None:
            values[key] = value
    kind: type[GuardConfig]
    if "bridge" in values:
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


def _check_together(agents: "list[SimulatedDroneConfig]") -> None:
    """ConfigError where one process cannot be all of them: they share its bus, and nothing else."""
    numbers = [agent.sysid for agent in agents]
    for wrong, text in (
        (len(set(numbers)) < len(numbers), "sysid: each drone needs its own"),
        (any(agent.keys is not None for agent in agents), "keys: a drone with keys is a process of its own"),
        (len({agent.lab for agent in agents}) > 1, "lab: the drones of one process are in one lab"),
    ):
        if wrong:
            raise ConfigError([f"drone-agent: {text}"])


def _laid_over(options: Options) -> dict[str, Any]:
    links = {
        "kind": options.link,
        "host": options.host,
        "zenoh_connect": None if options.zenoh_connect is None else [options.zenoh_connect],
    }
    return {
        "sysid": options.sysid,
        "lab": options.lab,
        "body": options.body,
        "autopilot": options.autopilot,
        "bridge": options.bridge,
        "pose": options.pose,
        "profile": options.profile,
        "start_lab_m": None if options.start is None else [_number(word) for word in options.start.split(",")],
        "start_yaw_rad": options.yaw,
        "truth_rate_hz": options.truth,
        "keys": options.keys,
        "insecure": options.insecure,
        "stale_setpoint_s": options.stale_setpoint,
        "stale_land_s": options.stale_land,
        "link": {key: value for key, value in links.items() if value is not None},
        "parameters": {name: _number(word) for name, _, word in (item.partition("=") for item in options.param or ())},
    }


def _number(word: str) -> float | str:
    """The number that a word is; the word itself where it is none, which the configuration then rejects."""
    try:
        return float(word)
    except ValueError:
        return word


def _fail(text: str, code: int) -> None:
    print_json_error(text)
    sys.stderr.write(f"{text}\n")
    raise typer.Exit(code)


def main() -> None:
    """The console script."""
    app()


if __name__ == "__main__":
    main()

"""`gcs-sim`: simulated flights, in lockstep or by real processes in real time.

Exit codes: 0 flown; 1 the flight was aborted, the lab's own law failed, or it missed what is required of it; 2 the
command line, a scenario or a recording is not right; 3 starved: the machine was too slow for the simulators, which says
nothing of what flew; 130 interrupted.

Commands load what they need when they are called: asking for help waits for no compiler.
"""

import asyncio
import json
import sys
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Literal

import typer

from formation.exposure import is_loopback
from sim.cli import studies
from wire.process.output import dropping_output
from wire.process.program import Overwrite, print_json_error, program, starting, with_options

app = program(
    "Fly scenarios: `fly` with real processes in real time, `run` in lockstep as fast as the machine goes; "
    "`paper` and `league` are studies of many flights, `campaign` is one with faults.",
    "Exit codes: 0 flown; 1 aborted, or less than required; 2 something given is not right; "
    "3 starved, the machine was too slow for the simulators; 130 interrupted.",
)
Protocol = Literal["vrpn", "chingmu", "nokov", "natnet", "qtm", "vicon", "ros2"]


def _scenarios(incomplete: str) -> list[str]:
    """Names for the Tab key: shipped scenarios, and files here."""
    from sim.shipped import shipped

    return starting((*shipped(), *(str(path) for path in Path().glob("*.toml"))), incomplete)


Name = Annotated[
    str,
    typer.Argument(
        metavar="SCENARIO",
        help="A shipped scenario's name, a scenario's file, or a lab file.",
        autocompletion=_scenarios,
    ),
]
Seed = Annotated[int | None, typer.Option(min=0, help="Decides all luck; without it the scenario's own.")]
LeaderCsv = Annotated[
    Path | None, typer.Option(help="The leader's recorded poses (CSV: EuRoC, TUM, Motive, Vicon; or a rosbag2).")
]
Alignment = Annotated[
    str | None, typer.Option(metavar="W,X,Y,Z", help="Turns the leader's marker frame: q_marker_from_flu.")
]
Json = Annotated[bool, typer.Option("--json", help="Print JSON, and nothing else there.")]
Require = Annotated[
    list[str] | None,
    typer.Option(metavar="KEY<NUMBER", help="Exit code 1 unless the summary reaches it; again for more."),
]
Out = Annotated[Path | None, typer.Option(help="The run's directory; without it runs/TIME-SCENARIO.")]


@dataclass(frozen=True, slots=True)
class FlyOptions:
    """The options of a flight in real time."""

    name: Name = "triangle_line"
    link: Annotated[Literal["zenoh", "udp"], typer.Option(help="How MAVLink reaches the drones.")] = "zenoh"
    mocap: Annotated[Protocol | None, typer.Option(help="Poses by this camera system's own protocol.")] = None
    seed: Seed = None
    leader_csv: LeaderCsv = None
    leader_alignment: Alignment = None
    force: Annotated[bool, typer.Option("--force", help="Fly a preset whose delay margin the ground refuses.")] = False
    speed: Annotated[
        float | None,
        typer.Option(min=0.01, max=1.0, help="Seconds of flight in one second; if not given, as the machine keeps up."),
    ] = None
    require: Require = None
    watch: Annotated[bool, typer.Option("--watch", help="Serve the operator's page, and print where.")] = False
    signed: Annotated[bool, typer.Option("--signed", help="With the lab file's own keys on every link.")] = False
    hosts: Annotated[
        int | None, typer.Option(min=1, help="So many processes share the drones; without it each is one.")
    ] = None
    practice: Annotated[
        bool,
        typer.Option("--practice", help="Cameras and drones alone: you run `gcs run` and the operator's commands."),
    ] = False
    as_json: Json = False
    out: Out = None
    overwrite: Overwrite = False


@app.command()
@with_options(FlyOptions)
def fly(options: FlyOptions) -> None:
    """Fly in real time: emulated mocap, agents and `gcs run` as processes of their own. Ctrl-C lands and ends."""
    from sim.cli import flights

    if options.practice:
        flights.practise(options)
    else:
        flights.fly(options)


@app.command()
def run(
    name: Name,
    seed: Seed = None,
    leader_csv: LeaderCsv = None,
    leader_alignment: Alignment = None,
    require: Require = None,
    as_json: Json = False,
    out: Out = None,
    overwrite: Overwrite = False,
) -> None:
    """Fly in lockstep: the same cores and bytes in one process, decided by scenario and seed alone."""
    from sim.cli import flights

    ending = flights.RunOutput(as_json, out, flights.required(require), overwrite)
    flights.run(flights.scenario_of(name, leader_csv, leader_alignment).scenario, seed, ending)


@app.command()
@dropping_output()
def mocap(
    name: Name,
    seed: Seed = None,
    _json: Json = False,
    speed: Annotated[float, typer.Option(min=0.01, max=1.0, hidden=True)] = 1.0,
) -> None:
    """Be the mocap of a scenario's simulated drones, on the bus of its lab, until Ctrl-C. JSON: its errors."""
    from sim.cli import flights

    flights.mocap(flights.scenario_of(name).scenario, seed, speed)


@app.command()
def check(
    name: Annotated[Path, typer.Argument(metavar="SCENARIO", help="A scenario's file, or a lab file.")],
    as_json: Json = False,
) -> None:
    """Judge a scenario and the lab that it flies; starts nothing. `gcs check` does the same."""
    from sim.cli.flights import check as check_scenario

    check_scenario(name, as_json)


@app.command("compile")
def compile_kernels(as_json: Json = False) -> None:
    """Compile everything that flies, once per installation, so that no start waits for it later."""
    from sim.cli import flights

    flights.compile_everything()
    if as_json:
        print(json.dumps({"compiled": True}))


@app.command("list")
def list_scenarios(as_json: Json = False) -> None:
    """Show the shipped scenarios."""
    from sim.shipped import about, shipped

    known = shipped()
    if as_json:
        print(json.dumps({name: about(path) for name, path in known.items()}))
        return
    width = max(map(len, known))
    for name, path in known.items():
        typer.echo(f"{name:{width}}  {about(path)}")


@app.command()
def campaign(
    runs: Annotated[int, typer.Option(min=0, help="How many flights with random faults.")] = 300,
    seed: Annotated[int, typer.Option(min=0, help="Decides, with a run's number, all about it.")] = 1,
    first: Annotated[int, typer.Option(min=0, help="The number of the first run: to go on with a campaign.")] = 0,
    family: Annotated[
        list[str] | None, typer.Option(metavar="NAME", help="Draw each run's first fault of it; again for more.")
    ] = None,
    profile: Annotated[str, typer.Option(help="Of the vehicles that fly.")] = "paper_40g",
    scheduler: Annotated[
        str | None, typer.Option(metavar="ADDRESS", help="Of a Dask cluster that flies instead of this machine.")
    ] = None,
    replay: Annotated[
        str | None, typer.Option(metavar="SEED:NUMBER", help="Fly this one run again and print its details.")
    ] = None,
    log: Annotated[Path | None, typer.Option(metavar="FILE.mcap", help="With --replay: log it there.")] = None,
    overwrite: Overwrite = False,
    controls: Annotated[
        int, typer.Option(min=0, metavar="N", help="And N flights without each monitor, which must then fail.")
    ] = 0,
    as_json: Annotated[bool, typer.Option("--json", help="Print the result as JSON, and nothing else there.")] = False,
) -> None:
    """Fly with random faults; judged by what is true of the drones alone. Exit code 1 if anything was not contained."""
    from sim.cli import campaign as commands

    draw = partial(commands.drawn_by, families=tuple(family or ()), vehicle=profile)
    if replay is not None:
        commands.run_again(replay, draw, log, as_json, overwrite)
    else:
        commands.run_campaign(draw(seed), range(first, first + runs), controls, scheduler, as_json)


@dataclass(frozen=True, slots=True)
class BoxOptions:
    """The options of an emulated camera system."""

    protocol: Annotated[Protocol | None, typer.Option(help="The vendor's protocol; of --lab if not given.")] = None
    lab: Annotated[
        Path | None,
        typer.Option(help="A lab file: its bodies, names, axes, unit and ports; if not given, three bodies."),
    ] = None
    still: Annotated[bool, typer.Option("--still", help="Nothing moves.")] = False
    csv: Annotated[
        Path | None,
        typer.Option(help="The first body moves as recorded (CSV: EuRoC, TUM, Motive, Vicon; or a rosbag2)."),
    ] = None
    cameras: Annotated[
        str,
        typer.Option(
            metavar="KEY=VALUE,...",
            help="rate_hz, jitter_s, noise_m, noise_rad, delay_s, delay_jitter_s, lost_share, occluded_share, burst: "
            "as in a scenario's [mocap].",
        ),
    ] = ""
    restart_every: Annotated[float | None, typer.Option(min=2.0, help="The server restarts so often, s.")] = None
    host: Annotated[str | None, typer.Option(help="Our address: 127.0.0.1, for NatNet 127.0.0.2.")] = None
    port: Annotated[int | None, typer.Option(min=1, max=65535, help="The vendor's own if not given.")] = None
    insecure: Annotated[
        bool, typer.Option("--insecure", help="Serve other machines; camera protocols know no keys.")
    ] = False
    seed: Annotated[int, typer.Option(min=0, help="Decides all luck.")] = 1
    as_json: Annotated[bool, typer.Option("--json", help="Events and errors as lines of JSON.")] = False
    speed: Annotated[float, typer.Option(min=0.01, max=1.0, hidden=True)] = 1.0


@app.command("mocap-server")
@with_options(BoxOptions)
@dropping_output()
def mocap_server(options: BoxOptions) -> None:
    """Serve moving bodies in a camera system's own protocol, until Ctrl-C."""
    from sim.cli.mocap_server import BoxError, box

    def print_text(text: str) -> None:
        print(text, file=sys.stderr, flush=True)

    def print_text_json(text: str) -> None:
        print(json.dumps({"text": text}), flush=True)

    try:
        if options.host is not None and not (options.insecure or is_loopback(options.host)):
            raise BoxError(f"--host {options.host} is not this machine, and camera protocols know no keys: --insecure")
        report = print_text_json if options.as_json else print_text
        asyncio.run(box(options).serve(options.restart_every, report))
    except KeyboardInterrupt:
        return
    except (BoxError, OSError) as error:
        print_json_error(str(error))
        print(f"gcs-sim: {error}", file=sys.stderr)
        raise typer.Exit(2) from error


studies.register(app)


def main() -> None:
    """The console script."""
    app()

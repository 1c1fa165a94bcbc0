"""`gcs-sim`: simulated flights, in lockstep or by real processes in real time.

Exit codes: 0 flown; 1 the flight was aborted, the lab's own law failed, or it missed what is required of it; 2 the
command line, a scenario or a recording is not right; 3 starved: the machine was too slow for the simulators, which says
nothing of what flew; 130 interrupted.

Commands load what they need when they are called: asking for help waits for no compiler.
"""

import json
from pathlib import Path
from typing import Annotated, Literal

import typer

from sim.cli import cameras, campaign, studies
from wire.process.output import dropping_output
from wire.process.program import program, starting

app = program(
    "Fly scenarios: `fly` with real processes in real time, `run` in lockstep as fast as the machine goes; "
    "`paper` and `robustness` are studies of many flights, `campaign` is one with faults.",
    "Exit codes: 0 flown; 1 aborted, or less than required; 2 something given is not right; "
    "3 starved, the machine was too slow for the simulators; 130 interrupted.",
)


def _scenarios(incomplete: str) -> list[str]:
    """What the Tab key offers: shipped scenarios, and files here."""
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
LeaderCsv = Annotated[Path | None, typer.Option(help="The leader's recorded poses (CSV: EuRoC, TUM, Motive, Vicon).")]
Alignment = Annotated[
    str | None, typer.Option(metavar="W,X,Y,Z", help="Turns the leader's marker frame: q_marker_from_flu.")
]
Json = Annotated[bool, typer.Option("--json", help="Print JSON, and nothing else there.")]
Require = Annotated[
    list[str] | None,
    typer.Option(metavar="KEY<NUMBER", help="Exit code 1 unless the summary reaches it; again for more."),
]
Out = Annotated[Path | None, typer.Option(help="The run's directory; without it runs/TIME-SCENARIO.")]


@app.command()
def fly(
    name: Name = "triangle_line",
    link: Annotated[Literal["zenoh", "udp"], typer.Option(help="How MAVLink reaches the drones.")] = "zenoh",
    mocap: Annotated[cameras.Protocol | None, typer.Option(help="Poses by this camera system's own protocol.")] = None,
    seed: Seed = None,
    leader_csv: LeaderCsv = None,
    leader_alignment: Alignment = None,
    force: Annotated[bool, typer.Option("--force", help="Fly a preset whose delay margin the ground refuses.")] = False,
    speed: Annotated[
        float, typer.Option(min=0.01, max=1.0, help="Seconds of flight in one second: slower on a slow machine.")
    ] = 1.0,
    require: Require = None,
    watch: Annotated[bool, typer.Option("--watch", help="Serve the operator's page, and print where.")] = False,
    signed: Annotated[bool, typer.Option("--signed", help="With the lab file's own keys on every link.")] = False,
    hosts: Annotated[
        int | None, typer.Option(min=1, help="So many processes share the drones; without it each is one.")
    ] = None,
    practice: Annotated[
        bool,
        typer.Option("--practice", help="Cameras and drones alone: you run `gcs run` and the operator's commands."),
    ] = False,
    as_json: Json = False,
    out: Out = None,
) -> None:
    """Fly in real time: emulated mocap, agents and `gcs run` as processes of their own. Ctrl-C lands and ends."""
    from sim.cli import flights

    required = flights.required(require)
    opened = flights.scenario_of(name, leader_csv, leader_alignment)
    how = flights.ProcessOptions(link, mocap, force, speed, watch, signed, hosts)
    if practice:
        flights.practise(opened, how, seed, out)
    else:
        flights.fly(opened, how, seed, flights.Ending(as_json, out, required))


@app.command()
def run(
    name: Name,
    seed: Seed = None,
    leader_csv: LeaderCsv = None,
    leader_alignment: Alignment = None,
    require: Require = None,
    as_json: Json = False,
    out: Out = None,
) -> None:
    """Fly in lockstep: the same cores and bytes in one process, decided by scenario and seed alone."""
    from sim.cli import flights

    ending = flights.Ending(as_json, out, flights.required(require))
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
    svg: Annotated[Path | None, typer.Option(metavar="FILE", help="Draw the lab from above into an SVG file.")] = None,
    as_json: Json = False,
) -> None:
    """Judge a scenario and the lab that it flies; starts nothing. `gcs check` does the same."""
    from sim.cli.check import check as check_scenario

    check_scenario(name, svg, as_json)


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


studies.register(app)
campaign.register(app)
cameras.register(app)


def main() -> None:
    """The console script."""
    app()

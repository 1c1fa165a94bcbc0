"""`gcs-sim`: simulated flights, in lockstep or by real processes in real time.

Exit codes: 0 flown; 1 the flight was aborted; 2 the command line, a scenario or a recording is not right;
3 starved: the machine was too slow for the simulators, which says nothing of what flew; 130 interrupted.
"""

import asyncio
import signal
import sys
from collections.abc import Coroutine
from datetime import datetime
from pathlib import Path
from typing import Annotated, Literal, NoReturn

import typer
import uvloop
from rich.console import Console
from rich.table import Table

from analysis.console import print_summary
from analysis.metrics import Summary
from formation.model import QuatTuple
from gcs.daemon import GCS_NAME
from gcs.mocap.csv_file import MocapFileError
from sim import lockstep, mocap_daemon
from sim.conclude import conclude
from sim.display import Display
from sim.fly import Files
from sim.fly import fly as fly_processes
from sim.ports import private_link
from sim.scenario import Scenario, load, recorded_leader, shipped, with_leader_file
from sim.script import Outcome
from sim.study_cli import app as study_app
from wire import clock, starved
from wire.config_file import ConfigError
from wire.private_files import make_folder
from wire.progress import compile_all
from wire.starved import StarvedError
from wire.zenoh_bus import BusError

ABORTED, NOT_RIGHT, INTERRUPTED = 1, 2, 130
UNIT_WITHIN = 0.01

app = typer.Typer(
    add_completion=False,
    pretty_exceptions_enable=False,
    no_args_is_help=True,
    help="Fly scenarios: `fly` with real processes in real time, `run` in lockstep as fast as the machine goes; "
    "`paper` and `robustness` are studies of many flights.",
    epilog="Exit codes: 0 flown; 1 aborted; 2 something given is not right; "
    "3 starved, the machine was too slow for the simulators; 130 interrupted.",
)

app.add_typer(study_app)

Name = Annotated[str, typer.Argument(metavar="SCENARIO", help="A shipped scenario's name or a TOML file.")]
Seed = Annotated[int | None, typer.Option(min=0, help="Decides all luck; without it the scenario's own.")]
LeaderCsv = Annotated[Path | None, typer.Option(help="The leader's recorded poses (ASL/EuRoC CSV).")]
Alignment = Annotated[
    str | None, typer.Option(metavar="W,X,Y,Z", help="Turns the leader's marker frame: q_marker_from_flu.")
]
Json = Annotated[Path | None, typer.Option("--json", help="Write the summary here as JSON.")]
Out = Annotated[Path | None, typer.Option(help="The run's directory; without it runs/TIME-SCENARIO.")]


@app.command()
def fly(
    name: Name = "triangle_line",
    link: Annotated[Literal["zenoh", "udp"], typer.Option(help="How MAVLink reaches the drones.")] = "zenoh",
    seed: Seed = None,
    leader_csv: LeaderCsv = None,
    leader_alignment: Alignment = None,
    force: Annotated[bool, typer.Option("--force", help="Fly a preset whose delay margin the ground refuses.")] = False,
    speed: Annotated[
        float, typer.Option(min=0.01, max=1.0, help="Seconds of flight in one second: slower on a slow machine.")
    ] = 1.0,
    json_file: Json = None,
    out: Out = None,
) -> None:
    """Fly in real time: emulated mocap, agents and `gcs run` as processes of their own. Ctrl-C lands and ends."""
    scenario = _scenario(name, leader_csv, leader_alignment)
    lab = scenario.lab
    own_link = private_link(link, (v.sysid for v in lab.vehicles if v.sysid is not None))
    scenario = scenario.model_copy(update={"lab": lab.model_copy(update={"link": own_link})})
    files = Files(_folder(out, scenario))
    console = Console()
    _compile(scenario)
    with Display(console, scenario.name) as display:
        flown = asyncio.run(
            _interruptible(
                fly_processes(scenario, _seed(seed, scenario), files, display.progress, force, clock.Clock(speed))
            )
        )
    outcome = flown or Outcome("aborted", "interrupted")
    if not files.mcap.exists():
        _fail(f"no log was written: {outcome.reason} (see {files.folder})", ABORTED)
    _end(conclude(files.mcap, outcome), json_file, console, ABORTED if flown else INTERRUPTED)


@app.command()
def run(
    name: Name,
    seed: Seed = None,
    leader_csv: LeaderCsv = None,
    leader_alignment: Alignment = None,
    json_file: Json = None,
    out: Out = None,
) -> None:
    """Fly in lockstep: the same cores and bytes in one process, decided by scenario and seed alone."""
    scenario = _scenario(name, leader_csv, leader_alignment)
    files = Files(_folder(out, scenario))
    console = Console()
    _compile(scenario)
    with Display(console, scenario.name) as display:
        flown = lockstep.run_to_file(scenario, _seed(seed, scenario), files.mcap, display.progress)
    _end(conclude(files.mcap, flown.outcome, flown.realtime_factor), json_file, console)


@app.command()
def mocap(
    name: Name, seed: Seed = None, speed: Annotated[float, typer.Option(min=0.01, max=1.0, hidden=True)] = 1.0
) -> None:
    """Be the mocap of a scenario's simulated drones, on the bus of its lab, until Ctrl-C."""
    scenario = _scenario(name, None, None)
    try:
        uvloop.run(mocap_daemon.serve(scenario, _seed(seed, scenario), GCS_NAME, clock.Clock(speed)))
    except BusError as error:
        _fail(str(error), NOT_RIGHT)
    except StarvedError as error:
        _fail(str(error), starved.EXIT_CODE)


@app.command("compile")
def compile_kernels() -> None:
    """Compile everything that flies, once per installation, so that no start waits for it later."""
    _compile(load("triangle_line"))


@app.command("list")
def list_scenarios() -> None:
    """Show the shipped scenarios."""
    table = Table(box=None, show_header=False, padding=(0, 2, 0, 0))
    for name in shipped():
        table.add_row(name, load(name).about)
    Console(markup=False).print(table)


async def _interruptible(flight: Coroutine[None, None, Outcome]) -> Outcome | None:
    """The flight's outcome, None where SIGINT or SIGTERM ended it; the second signal does not wait for a landing."""
    flying = asyncio.create_task(flight)
    loop = asyncio.get_running_loop()
    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, flying.cancel)
    try:
        return await flying
    except asyncio.CancelledError:
        return None


def _scenario(name: str, leader_csv: Path | None, alignment: str | None) -> Scenario:
    """The scenario with the leader given; ends the process where either is not right."""
    try:
        scenario = load(name)
        file = None if leader_csv is None else str(leader_csv.absolute())
        scenario = with_leader_file(scenario, file, None if alignment is None else _quaternion(alignment))
        if scenario.needs_leader_file and scenario.leader.file is None:
            raise ValueError(f"{scenario.name} needs a recorded leader: --leader-csv FILE")
        recorded_leader(scenario)
    except (ConfigError, MocapFileError, ValueError) as error:
        _fail(str(error), NOT_RIGHT)
    return scenario


def _compile(scenario: Scenario) -> None:
    """Everything that any process of the scenario runs; the processes find it in the cache on disk."""
    compile_all("gcs-sim", lambda: lockstep.warm_up(scenario), sys.stderr)


def _quaternion(text: str) -> QuatTuple:
    """Unit quaternion of "w,x,y,z"; ValueError for anything else."""
    try:
        w, x, y, z = (float(part) for part in text.split(","))
    except ValueError as error:
        raise ValueError(f"--leader-alignment {text}: expected four numbers W,X,Y,Z") from error
    norm = (w * w + x * x + y * y + z * z) ** 0.5
    if not abs(norm - 1.0) < UNIT_WITHIN:
        raise ValueError(f"--leader-alignment {text}: its length is {norm:.3g}, not 1")
    return w / norm, x / norm, y / norm, z / norm


def _seed(given: int | None, scenario: Scenario) -> int:
    return scenario.seed if given is None else given


def _folder(out: Path | None, scenario: Scenario) -> Path:
    folder = out or Path("runs") / f"{datetime.fromtimestamp(clock.unix_us() * 1e-6):%Y%m%d-%H%M%S}-{scenario.name}"
    make_folder(folder)
    return folder


def _end(summary: Summary, json_file: Path | None, console: Console, aborted_code: int = ABORTED) -> None:
    """Show the run's numbers; end with `aborted_code` where it was aborted."""
    print_summary(summary, console)
    if json_file is not None:
        json_file.write_text(summary.to_json() + "\n", encoding="utf-8")
    if summary.outcome.startswith("starved"):
        raise typer.Exit(starved.EXIT_CODE)
    if summary.outcome.startswith("aborted"):
        raise typer.Exit(aborted_code)


def _fail(text: str, code: int) -> NoReturn:
    Console(stderr=True).print(f"gcs-sim: {text}", style="red", highlight=False, markup=False, soft_wrap=True)
    raise typer.Exit(code)


def main() -> None:
    """The console script."""
    app()


if __name__ == "__main__":
    main()

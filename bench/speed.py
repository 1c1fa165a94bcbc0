"""What people wait for, and what bounds it: `python -m bench.speed`; beside another commit with `--against REV`.

Each row is a command in a process of its own. The other commit runs the same command on the same files, in turn with
this one: what a machine does besides differs from minute to minute, a ratio of one run hardly does.
"""

import json
import os
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated

import typer
from rich import box
from rich.console import Console
from rich.table import Table

from bench.command import FAILED, Json
from sim.lockstep import run_to_file
from sim.scenario import Scenario, load

ROOT = Path(__file__).parents[1]
SCENARIO, LANDING_S = "triangle_circle", 60.0
LOG = "flight.mcap"
TURNS = 3
"""Of which the best counts: what other programs cost is never negative."""
_LOADED = """
import sys
from gcs_log import flight_log
flight_log.READER = (sys.executable, "-P", "-m", "analysis.tables")  # of this commit, whatever is installed
log = flight_log.load("flight.mcap")
"""
_FLOWN = """
import time
from bench.call_counts import Calls
from sim.lockstep import uncollected, warm_up
from sim.scenario import load
from sim.world import T0_NS, World
scenario = load("{name}")
warm_up(scenario)
world = World(scenario, scenario.seed, lambda *_: None)
def fly(end_s):
    while world.now_ns < T0_NS + end_s * 1e9:
        world.step()
with uncollected():
    fly({begin_s})
    begun_s = time.process_time()
    fly({end_s})
    cpu_s = time.process_time() - begun_s
    with Calls() as calls:
        fly({end_s} + 1)
print(f"{{({end_s} - {begin_s}) / cpu_s:.1f}} times real time, {{calls.count:,}} calls a second")
"""
_STUDIED = """
from bench.speed import flight
from sim.research.host import fly
fly(flight(210.0), seed=1)
"""
_COMPILED = """
import os, tempfile
with tempfile.TemporaryDirectory() as os.environ["NUMBA_CACHE_DIR"]:
    from sim.cli.flights import compile_everything
    compile_everything()
"""


class AgainstError(RuntimeError):
    """The other commit cannot be had, or does not run; the text says why."""


@dataclass(frozen=True, slots=True)
class Row:
    """One thing that somebody waits for. arguments: Python's, in a folder that holds LOG; bound: what bounds it now.

    speaks: whether what it prints is shown beside that.
    """

    name: str
    arguments: tuple[str, ...]
    bound: str
    speaks: bool = False


def gcs_log(command: str, bound: str, *options: str) -> Row:
    """A command of `gcs-log`, on LOG."""
    return Row(command, ("-m", "sim.cli.log", command, LOG, *options), bound)


def lockstep(name: str, scenario: str, begin_s: float, end_s: float) -> Row:
    """A lockstep flight, timed between two of its simulated seconds."""
    command = _FLOWN.format(name=scenario, begin_s=begin_s, end_s=end_s)
    return Row(
        name, ("-c", command), "the guards' navigator, 9 to 15 %; Python calls, none of them above 3 %", speaks=True
    )


ROWS = (
    Row("load", ("-c", _LOADED), "two processes start, with numpy; chunks are unpacked, messages found"),
    Row(
        "tables",
        ("-c", f"{_LOADED}[len(table) for table in log.values()]"),
        "the same twice; single precision as double",
    ),
    gcs_log("check", "Python's start, a third; then as load, and each message's tags are compared"),
    gcs_log("report", "matplotlib's pictures, three quarters", "--out", "report.html"),
    gcs_log("replay", "the ground's core, three quarters"),
    lockstep("lockstep 3", "px4_circle", 12.0, 24.0),
    lockstep("lockstep 21", "twenty", 12.0, 15.0),
    Row("study", ("-c", _STUDIED), "of 218 s with three drones: the control's turns, a half; cameras, bodies"),
    Row("compile", ("-c", _COMPILED), "numba's types and lowering in Python, two thirds; LLVM"),
)
"""Add a row here; its command may read the folder's files, and write beside them."""


@dataclass(frozen=True, slots=True)
class Cost:
    """Of one command with all processes that it starts: CPU and wall time, s; the most memory of one of them, MB.

    said: the last line that it printed.
    """

    cpu_s: float
    wall_s: float
    peak_mb: float
    said: str = ""


_MEASURED = """
import json, resource, subprocess, sys, time
begun_s = time.monotonic()
done = subprocess.run([sys.executable, "-P", *sys.argv[1:]], stdout=subprocess.PIPE, text=True)
wall_s, usage = time.monotonic() - begun_s, resource.getrusage(resource.RUSAGE_CHILDREN)
said = "".join(done.stdout.splitlines()[-1:])
print(json.dumps([done.returncode, usage.ru_utime + usage.ru_stime, wall_s, usage.ru_maxrss / 1024.0, said]))
"""
"""By a small process of its own: the memory of a large one that starts another counts as the other's, too."""


def cost(tree: Path, arguments: Sequence[str], folder: Path) -> Cost:
    """Run a command of the commit whose files are in `tree`; AgainstError where it fails."""
    environment = os.environ | {"PYTHONPATH": str(tree)}
    command = [sys.executable, "-P", "-c", _MEASURED, *arguments]
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=True)
    code, cpu_s, wall_s, peak_mb, said = json.loads(done.stdout)
    if code:
        words = done.stderr.strip().splitlines()[-1:] or [f"exit code {code}"]
        raise AgainstError(f"{' '.join(arguments)}: {words[0]}")
    return Cost(cpu_s, wall_s, peak_mb, said)


@contextmanager
def checkout(revision: str, repository: Path = ROOT) -> Iterator[Path]:
    """The files of a commit of the repository, for a while; AgainstError."""
    with TemporaryDirectory() as folder:
        archive = Path(folder) / "commit.tar"
        tree = Path(folder) / "tree"
        tree.mkdir()
        _run("git", "-C", str(repository), "archive", "--output", str(archive), revision)
        _run("tar", "-x", "-f", str(archive), "-C", str(tree))
        yield tree


def _run(*command: str) -> None:
    """AgainstError with its last words where it fails."""
    try:
        subprocess.run(command, capture_output=True, text=True, check=True)
    except OSError as error:
        raise AgainstError(f"{command[0]}: {error.strerror or error}") from error
    except subprocess.CalledProcessError as error:
        words = error.stderr.strip().splitlines()[-1:] or [f"exit code {error.returncode}"]
        raise AgainstError(words[0]) from error


def least(costs: Sequence[Cost]) -> Cost:
    """The least of each number, and what the one of the least CPU time said."""
    best = min(costs, key=lambda each: each.cpu_s)
    return Cost(best.cpu_s, min(each.wall_s for each in costs), min(each.peak_mb for each in costs), best.said)


@dataclass(frozen=True, slots=True)
class Measured:
    """One row; there: at the other commit, None where none was asked for or it fails there."""

    row: Row
    here: Cost
    there: Cost | None

    @property
    def ratio(self) -> float | None:
        """CPU time here over there."""
        return None if self.there is None else self.here.cpu_s / self.there.cpu_s


def measure(row: Row, other: Path | None, folder: Path) -> Measured:
    """In turn here and in the other commit's files; AgainstError where it fails here."""
    here, there = list[Cost](), list[Cost]()
    for _ in range(TURNS):
        here.append(cost(ROOT, row.arguments, folder))
        with suppress(AgainstError):  # it may not have the command, or replay what is recorded otherwise
            there += [] if other is None else [cost(other, row.arguments, folder)]
    return Measured(row, least(here), least(there) if there else None)


def flight(seconds: float) -> Scenario:
    """Three drones that fly circles for so long."""
    scenario = load(SCENARIO)
    leader = scenario.lab.leader
    trajectory = leader.trajectory.model_copy(update={"duration_s": seconds})
    lab = scenario.lab.model_copy(update={"leader": leader.model_copy(update={"trajectory": trajectory})})
    return scenario.model_copy(update={"lab": lab, "formation_s": seconds, "longest_s": seconds + LANDING_S})


def to_json(rows: Sequence[Measured], seconds: float, revision: str | None) -> str:
    """Indented JSON: of each row its cost here and there, their ratio, and what bounds it."""
    figures = {
        each.row.name: {
            "here": asdict(each.here),
            "there": None if each.there is None else asdict(each.there),
            "ratio": each.ratio,
            "bound": each.row.bound,
        }
        for each in rows
    }
    return json.dumps({"flight_s": seconds, "against": revision, "rows": figures}, indent=2, allow_nan=False)


def table(rows: Sequence[Measured], revision: str | None) -> Table:
    """What a person reads of it."""
    found = Table(box=box.SIMPLE_HEAD)
    for k, heading in enumerate(("", "CPU, s", "wall, s", "MB", revision or "", "ratio", "bound by")):
        found.add_column(heading, justify="right" if 0 < k < 6 else "left")
    for each in rows:
        here, there = each.here, each.there
        other = ("", "") if there is None or each.ratio is None else (f"{there.cpu_s:.2f}", f"{each.ratio:.2f}")
        bound = f"{here.said}; {each.row.bound}" if each.row.speaks else each.row.bound
        found.add_row(each.row.name, f"{here.cpu_s:.2f}", f"{here.wall_s:.2f}", f"{here.peak_mb:.0f}", *other, bound)
    return found


def main(
    revision: Annotated[str | None, typer.Option("--against", metavar="REV", help="Beside this commit.")] = None,
    only: Annotated[list[str] | None, typer.Option("--row", help="This row; can be given again.")] = None,
    seconds: Annotated[float, typer.Option(min=10.0, help="Of the flight whose log is read.")] = 210.0,
    as_json: Json = False,
) -> None:
    """Measure what people wait for. It shows, and judges nothing; exit code 1 where a command fails."""
    chosen = [row for row in ROWS if not only or row.name in only]
    console = Console(stderr=True, markup=False)
    try:
        with ExitStack() as stack:
            folder = Path(stack.enter_context(TemporaryDirectory()))
            other = None if revision is None else stack.enter_context(checkout(revision))
            status = stack.enter_context(console.status("the flight"))
            scenario = flight(seconds)
            run_to_file(scenario, scenario.seed, folder / LOG)
            found = []
            for row in chosen:
                status.update(row.name)
                found.append(measure(row, other, folder))
    except AgainstError as error:
        typer.echo(f"bench.speed: {error}", err=True)
        raise typer.Exit(FAILED) from error
    if as_json:
        typer.echo(to_json(found, seconds, revision))
    else:
        Console().print(table(found, revision))


if __name__ == "__main__":
    typer.run(main)

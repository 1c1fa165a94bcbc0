"""`gcs-sim benchmark`: against what others have recorded, against attackers of a lab with keys, and for a long time."""

import json
from dataclasses import asdict
from math import isnan
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from rich.table import Table

    from sim.studies.hostile.figures import Figures
    from sim.studies.neural_fly.flights import Job, Score

FAILED, NOT_RIGHT = 1, 2
app = typer.Typer(
    help="Measure against what others have recorded, against attacks, and for long.", no_args_is_help=True
)


@app.command("neural-fly")
def neural_fly(
    data: Annotated[Path, typer.Option(help="Folder of custom_figure8_*.csv (github aerorobotics/neural-fly).")],
    only: Annotated[list[str] | None, typer.Option(help="Fly this controller; can be given again.")] = None,
    seed: Annotated[int, typer.Option(min=0, help="Decides all luck.")] = 1,
    as_json: Annotated[bool, typer.Option("--json", help="Print the result as JSON, and nothing else there.")] = False,
) -> None:
    """Fly Neural-Fly's figure-8 in the recorded force of its five winds; exit code 1 if any flight did not land."""
    from rich.console import Console

    from sim.studies.neural_fly import flights
    from sim.studies.neural_fly.recordings import METHODS, RecordingError, path_of, read
    from sim.studies.runner import Runner
    from wire.process.program import print_json_error

    console = Console(stderr=as_json, markup=False)
    try:
        jobs = flights.jobs(data, tuple(only or flights.SHOWN), seed)
        flown = {
            method: [
                read(path_of(data, method, job.wind)).rms_m for job in jobs if job.controller == jobs[0].controller
            ]
            for method in METHODS
            if path_of(data, method, jobs[0].wind).exists()
        }
        scores = Runner(console).run("flights", flights.fly, jobs)
    except RecordingError as error:
        print_json_error(str(error))
        console.print(f"gcs-sim: {error}", style="red", highlight=False)
        raise typer.Exit(NOT_RIGHT) from error
    except ValueError as error:
        raise typer.BadParameter(str(error)) from error
    console.print(_table(flown, jobs, scores))
    if as_json:
        rows = [
            {"controller": job.controller, "wind": job.wind}
            | {key: None if _is_nan(value) else value for key, value in asdict(score).items()}
            for job, score in zip(jobs, scores, strict=True)
        ]
        print(json.dumps({"flown_rms_m": flown, "simulated": rows}, indent=2))
    if any(score.outcome != "landed" for score in scores):
        raise typer.Exit(FAILED)


@app.command()
def security(
    stops: Annotated[int, typer.Option(min=1, help="How many `gcs stop` beside the flood.")] = 30,
    setpoints: Annotated[int, typer.Option(min=1, help="How many signed setpoints, 100 a second.")] = 1000,
    as_json: Annotated[bool, typer.Option("--json", help="Print the result as JSON, and nothing else there.")] = False,
) -> None:
    """Measure what keys cost and what they withstand, by real sockets on loopback. It judges nothing."""
    from tempfile import TemporaryDirectory

    from rich.console import Console

    from sim.studies.hostile.figures import measure

    console = Console(stderr=True, markup=False)
    with TemporaryDirectory() as folder, console.status("starting") as status:
        figures = measure(Path(folder), stops, setpoints, status.update)
    if as_json:
        print(figures.to_json())
    else:
        Console(markup=False).print(_security_table(figures))


@app.command()
def soak(
    followers: Annotated[int, typer.Option(min=1, max=249, help="How many follow.")] = 9,
    minutes: Annotated[float, typer.Option(min=0.5, help="Of hover; ten drones take half as long in lockstep.")] = 10.0,
    processes: Annotated[bool, typer.Option("--processes", help="In real time, by real processes.")] = False,
    hosts: Annotated[int | None, typer.Option(min=1, help="The same; so many of them share the drones.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print the result as JSON, and nothing else there.")] = False,
) -> None:
    """Hover for long, and measure what memory and log grow by; exit code 1 if it did not last and land."""
    import asyncio
    from tempfile import TemporaryDirectory

    from rich.console import Console

    from sim.studies.scale.soak import soak as hover_for_long
    from sim.studies.scale.soak import soak_by_processes

    console = Console(stderr=True, markup=False)
    with TemporaryDirectory() as folder, console.status("starting") as status:
        arguments = followers, 60.0 * minutes, Path(folder), status.update
        if processes or hosts is not None:
            result = asyncio.run(soak_by_processes(*arguments, hosts))
        else:
            result = hover_for_long(*arguments)
    if as_json:
        print(result.to_json())
    else:
        last = result.samples[-1] if result.samples else None
        late = f", {last.late} of {last.cycles} control cycles late" if last and last.cycles else ""
        Console(markup=False).print(
            f"{result.drones} drones, {minutes:g} minutes at {result.speed:.1f} times real time, {result.outcome}: "
            f"memory grows {result.memory_bytes_h * 1e-6:.1f} MB an hour, "
            f"the log {result.log_bytes_s_drone * 1e-3:.1f} kB a second and drone{late}",
            soft_wrap=True,
        )
    if result.outcome != "landed":
        raise typer.Exit(FAILED)


@app.command()
def swarm(
    followers: Annotated[int, typer.Option(min=1, max=249, help="How many follow.")] = 99,
    seconds: Annotated[float, typer.Option(min=1.0, help="Of hover; a hundred drones take minutes.")] = 10.0,
    hosts: Annotated[
        int | None, typer.Option(min=1, help="By real processes, so many of which share the drones; else in lockstep.")
    ] = None,
    speed: Annotated[float, typer.Option(min=0.01, max=1.0, help="With --hosts: seconds of flight in one.")] = 1.0,
    as_json: Annotated[bool, typer.Option("--json", help="Print the result as JSON, and nothing else there.")] = False,
) -> None:
    """Hover with many drones; exit code 1 if one did not land, or two came too near to each other."""
    from tempfile import TemporaryDirectory

    from rich.console import Console

    from sim.cli.flights import compile_everything
    from sim.studies.scale.swarm import swarm as hover_with_many
    from sim.studies.scale.swarm import swarm_by_processes
    from wire.clock import Clock

    compile_everything()
    console = Console(stderr=True, markup=False)
    with TemporaryDirectory() as folder, console.status("starting") as status:
        if hosts is None:
            result = hover_with_many(followers, seconds, status.update)
        else:
            arguments = followers, seconds, hosts, Path(folder), status.update, Clock(speed)
            result = swarm_by_processes(*arguments)
    if as_json:
        print(result.to_json())
    else:
        Console(markup=False).print(result.text, soft_wrap=True)
    if not result.is_good:
        raise typer.Exit(FAILED)


def _security_table(figures: "Figures") -> "Table":
    """A row a figure."""
    from rich.table import Table

    signing, alone, beside = figures.signing, figures.setpoints_alone, figures.setpoints_beside_flood
    table = Table(title=f"keys on {figures.cores} cores, load {figures.load:.1f}", show_header=False)
    table.add_row("sign, verify a packet", f"{signing.sign_us:.1f}, {signing.verify_us:.1f} µs")
    table.add_row(
        "100 drones at 100 Hz, of a core", f"{signing.sign_core_share:.1%}, {signing.verify_core_share:.1%}"
    )  # fmt: skip
    for name, hop in (("bus without keys", figures.hop_plain), ("bus with keys", figures.hop_with_keys)):
        table.add_row(f"{name}, median and 99 %", f"{hop.p50_us:.0f}, {hop.p99_us:.0f} µs")
    for arrivals in (alone, beside):
        table.add_row(
            f"setpoints beside {arrivals.hostile_hz:,.0f} hostile datagrams a second",
            f"{arrivals.accepted} of {arrivals.sent}, median {arrivals.p50_ms:.2f}, 99 % {arrivals.p99_ms:.2f} ms, "
            f"{arrivals.core_share:.0%} of a core",
        )
    for where, stops in (("", figures.stops), (" from another computer", figures.stops_from_elsewhere)):
        table.add_row(
            f"gcs stop{where} beside {stops.requests_hz:.0f} requests a second and half-open connections",
            f"{stops.answered} of {stops.asked} answered, {stops.in_time} within 0.5 s, worst {stops.worst_s:.2f} s",
        )
    return table


def _is_nan(value: object) -> bool:
    """What JSON does not have."""
    return isinstance(value, float) and isnan(value)


def _table(flown: "dict[str, list[float]]", jobs: "list[Job]", scores: "list[Score]") -> "Table":
    """RMS distance from the reference, cm: a row a method or controller, a column a wind."""
    from rich.table import Table

    from sim.studies.neural_fly.recordings import WINDS

    table = Table(title="RMS distance from the reference, cm, by wind, m/s")
    for heading in ("", *WINDS.values()):
        table.add_column(heading, justify="right" if heading else "left")
    for method, rms_m in flown.items():
        table.add_row(f"{method}, flown", *(f"{100 * value:.1f}" for value in rms_m))
    for first in range(0, len(jobs), len(WINDS)):
        row = scores[first : first + len(WINDS)]
        cells = (f"{100 * s.rms_m:.1f}" if s.outcome == "landed" else s.outcome for s in row)
        table.add_row(f"{jobs[first].controller}, simulated", *cells)
    return table

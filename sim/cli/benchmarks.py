"""`gcs-sim benchmark`: flights against what others have recorded, from files that the user has fetched."""

import json
from dataclasses import asdict
from math import isnan
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from rich.table import Table

    from sim.studies.neural_fly.flights import Job, Score

FAILED, NOT_RIGHT = 1, 2
app = typer.Typer(help="Fly against what others have recorded; the files are yours to fetch.", no_args_is_help=True)


@app.callback()
def benchmark() -> None:
    """Keep `neural-fly` a command of its own, although it is the only one."""


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

"""The command line: `python -m bench.neural_fly`."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.table import Table

from bench.command import FAILED, Json, Only
from bench.neural_fly import flights
from bench.neural_fly.flights import Job, Score
from sim.cli.studies import without_nan
from sim.studies.neural_fly import METHODS, WINDS, path_of, read
from sim.studies.runner import Runner


def main(
    data: Annotated[Path, typer.Option(help="Folder of custom_figure8_*.csv (github aerorobotics/neural-fly).")],
    only: Only = None,
    seed: Annotated[int, typer.Option(min=0, help="Decides all luck.")] = 1,
    as_json: Json = False,
) -> None:
    """Fly Neural-Fly's figure-8 in the recorded force of its five winds; exit code 1 if any flight did not land."""
    console = Console(stderr=as_json, markup=False)
    try:
        jobs = flights.jobs(data, tuple(only or flights.SHOWN), seed)
        flown = {
            method: [read(path_of(data, method, wind)).rms_m for wind in WINDS]
            for method in METHODS
            if path_of(data, method, jobs[0].wind).exists()
        }
        scores = Runner(console).run("flights", flights.fly, jobs)
    except ValueError as error:  # a recording that cannot be used, too
        raise typer.BadParameter(str(error)) from error
    console.print(table(flown, jobs, scores))
    if as_json:
        rows = [
            {"controller": job.controller, "wind": job.wind} | asdict(score)
            for job, score in zip(jobs, scores, strict=True)
        ]
        print(json.dumps({"flown_rms_m": flown, "simulated": without_nan(rows)}, indent=2))
    if any(score.outcome != "landed" for score in scores):
        raise typer.Exit(FAILED)


def table(flown: Mapping[str, Sequence[float]], jobs: Sequence[Job], scores: Sequence[Score]) -> Table:
    """RMS distance from the reference, cm: a row a method or controller, a column a wind."""
    shown = Table(title="RMS distance from the reference, cm, by wind, m/s")
    for heading in ("", *WINDS.values()):
        shown.add_column(heading, justify="right" if heading else "left")
    for method, rms_m in flown.items():
        shown.add_row(f"{method}, flown", *(f"{100 * value:.1f}" for value in rms_m))
    for first in range(0, len(jobs), len(WINDS)):
        row = scores[first : first + len(WINDS)]
        cells = (f"{100 * s.rms_m:.1f}" if s.outcome == "landed" else s.outcome for s in row)
        shown.add_row(f"{jobs[first].controller}, simulated", *cells)
    return shown


if __name__ == "__main__":
    typer.run(main)

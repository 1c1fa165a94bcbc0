"""What `gcs-sim campaign` does: flights with faults on every core, verdicts, a table."""

import json
from dataclasses import asdict

import typer
from rich.console import Console
from rich.table import Table

from sim.campaign.oracle import Verdict
from sim.campaign.table import fly_row, table
from sim.cli.flights import compile_for, fail
from sim.scenario import load as load_scenario
from sim.studies.runner import Runner

FAILED, NOT_RIGHT = 1, 2


def run_table(only: tuple[str, ...], workers: int | None, as_json: bool) -> None:
    """The faults that were found, each flown once."""
    console = Console(stderr=as_json, markup=False)
    names = [row.name for row in table()]
    if unknown := [name for name in only if name not in names]:
        fail(f"no row {unknown[0]!r} in the table; there are: {', '.join(names)}", NOT_RIGHT)
    wanted = [name for name in names if not only or name in only]
    compile_for(load_scenario("triangle_line"))
    verdicts = Runner(console, workers).run("table", fly_row, wanted)
    flown = dict(zip(wanted, verdicts, strict=True))
    if as_json:
        print(json.dumps({name: asdict(verdict) for name, verdict in flown.items()}, indent=2))
    console.print(_page(flown))
    uncontained = sum(not verdict.contained for verdict in verdicts)
    console.print(f"{len(verdicts)} faults, {uncontained} not contained", highlight=False)
    if uncontained:
        raise typer.Exit(FAILED)


def _page(flown: dict[str, Verdict]) -> Table:
    page = Table(title="how each fault ends; again with --table --only NAME")
    for heading in ("fault", "ends", "told after, s", "drift, m", "first told"):
        page.add_column(heading, justify="right" if heading.endswith((" s", " m")) else "left")
    for name, verdict in flown.items():
        ends = "contained" if verdict.contained else "; ".join(violation.text for violation in verdict.violations[:2])
        told = "-" if verdict.detection_s is None else f"{verdict.detection_s:.2f}"
        drift = "-" if verdict.onset_s is None else f"{verdict.drift_m:.2f}"
        page.add_row(name, ends, told, drift, verdict.cause, style=None if verdict.contained else "red")
    return page

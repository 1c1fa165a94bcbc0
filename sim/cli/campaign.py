"""The command line of `gcs-sim campaign`."""

from functools import partial
from pathlib import Path
from typing import Annotated

import typer


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command("campaign")(campaign)


def campaign(
    runs: Annotated[int, typer.Option(min=0, help="How many flights with random faults.")] = 300,
    seed: Annotated[int, typer.Option(min=0, help="Decides, with a run's number, all about it.")] = 1,
    first: Annotated[int, typer.Option(min=0, help="The number of the first run: to go on with a campaign.")] = 0,
    family: Annotated[
        list[str] | None, typer.Option(metavar="NAME", help="Draw each run's first fault of it; again for more.")
    ] = None,
    profile: Annotated[str, typer.Option(help="Of the vehicles that fly.")] = "paper_40g",
    workers: Annotated[int | None, typer.Option(min=1, help="Processes; without it one a core.")] = None,
    scheduler: Annotated[
        str | None, typer.Option(metavar="ADDRESS", help="Of a Dask cluster that flies instead of this machine.")
    ] = None,
    replay: Annotated[
        str | None, typer.Option(metavar="SEED:NUMBER", help="Fly this one run again and print its details.")
    ] = None,
    log: Annotated[Path | None, typer.Option(metavar="FILE.mcap", help="With --replay: log it there.")] = None,
    table: Annotated[bool, typer.Option("--table", help="Fly each fault of the table once, show how it ends.")] = False,
    controls: Annotated[
        int, typer.Option(min=0, metavar="N", help="And N flights without each monitor, which must then fail.")
    ] = 0,
    only: Annotated[
        list[str] | None, typer.Option(metavar="NAME", help="Of table or controls this one alone; again for more.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print the result as JSON, and nothing else there.")] = False,
) -> None:
    """Fly with random faults; judged by what is true of the drones alone. Exit code 1 if anything was not contained."""
    from sim.cli import campaign_commands as commands

    draw = partial(commands.drawn_by, families=tuple(family or ()), vehicle=profile)
    if table:
        commands.run_table(tuple(only or ()), workers, as_json)
    elif replay is not None:
        commands.run_again(replay, draw, log, as_json)
    else:
        asked = commands.Asked(range(first, first + runs), draw(seed), controls, tuple(only or ()))
        commands.run_campaign(asked, workers, scheduler, as_json)

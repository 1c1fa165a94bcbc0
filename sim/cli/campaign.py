"""The command line of `gcs-sim campaign`."""

from typing import Annotated

import typer


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command("campaign")(campaign)


def campaign(
    table: Annotated[bool, typer.Option("--table", help="Fly each fault of the table once, show how it ends.")] = False,
    only: Annotated[
        list[str] | None, typer.Option(metavar="NAME", help="Of the table this row alone; again for more.")
    ] = None,
    workers: Annotated[int | None, typer.Option(min=1, help="Processes; without it one a core.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print the result as JSON, and nothing else there.")] = False,
) -> None:
    """Fly with faults; judged by what is true of the drones alone. Exit code 1 if anything was not contained."""
    from sim.cli import campaign_commands as commands

    if table:
        commands.run_table(tuple(only or ()), workers, as_json)

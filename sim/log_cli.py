"""`gcs-log`: what analysis says of a log (`report`, `check`, `picture`), and `replay`, which needs the ground's core.

Exit codes of `replay`: 0 bit-identical; 1 not; 2 no log, or one that cannot be replayed.
"""

import json as jsonlib
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from analysis.cli import app as analysis_app
from gcs.replay import Replay, ReplayError
from gcs.replay import replay as replay_log
from wire.mcap_log import LogError, read_log

DIFFERENT, NOT_RIGHT = 1, 2

app = typer.Typer(help="Read flight logs.", no_args_is_help=True, add_completion=False, pretty_exceptions_enable=False)
app.add_typer(analysis_app)


@app.command()
def replay(
    log: Annotated[Path, typer.Argument(metavar="FLIGHT.MCAP", help="The flight's log.")],
    json: Annotated[Path | None, typer.Option("--json", metavar="FILE", help="Also write the result as JSON.")] = None,
) -> None:
    """Feed a flight's inputs to the ground's core again: is every output the same, bit by bit?"""
    try:
        result = replay_log(read_log(log))
    except (OSError, LogError, ReplayError) as error:
        Console(stderr=True).print(f"gcs-log: {error}", style="red", highlight=False, markup=False, soft_wrap=True)
        raise typer.Exit(NOT_RIGHT) from error
    if json is not None:
        json.write_text(jsonlib.dumps(asdict(result) | {"identical": result.identical}, indent=2) + "\n")
    _show(result)
    if not result.identical:
        raise typer.Exit(DIFFERENT)


def _show(result: Replay) -> None:
    typer.echo(f"{result.inputs} inputs, {result.ticks} ticks, {result.agreed} outputs agree")
    typer.echo("bit-identical" if result.identical else f"first difference: {result.difference}")


def main() -> None:
    """The console script."""
    app()


if __name__ == "__main__":
    main()

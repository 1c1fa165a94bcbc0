"""`gcs-log`: what analysis says of a log (`report`, `check`, `picture`), and `replay`, which needs the ground's core.

Exit codes of `replay`: 0 bit-identical; 1 not; 2 no log, or one that cannot be replayed.
"""

import json
from dataclasses import asdict
from typing import TYPE_CHECKING

import typer

from analysis.cli import Json, LogPath
from analysis.cli import app as analysis_app
from wire.process.program import print_json_error, program
from wire.process.system import NOT_RIGHT

if TYPE_CHECKING:
    from gcs.replay import Replay

DIFFERENT = 1

app = program(
    "Read flight logs.",
    "Exit codes: 0 well; 1 the flight did not end well (report), the log is damaged (check), or is not replayed bit by "
    "bit (replay); 2 no log.",
)
app.add_typer(analysis_app)


@app.command()
def replay(log: LogPath, as_json: Json = False) -> None:
    """Feed a flight's inputs to the ground's core again: is every output the same, bit by bit?"""
    from gcs.replay import ReplayError
    from gcs.replay import replay as replay_log
    from wire.logs.mcap_read import read_log
    from wire.logs.mcap_scan import LogError

    try:
        result = replay_log(read_log(log))
    except (OSError, LogError, ReplayError) as error:
        print_json_error(str(error))
        typer.secho(f"gcs-log: {error}", fg="red", err=True)
        raise typer.Exit(NOT_RIGHT) from error
    if as_json:
        typer.echo(json.dumps(asdict(result) | {"identical": result.identical}, indent=2))
    else:
        _show(result)
    if not result.identical:
        raise typer.Exit(DIFFERENT)


def _show(result: "Replay") -> None:
    typer.echo(f"{result.inputs} inputs, {result.ticks} ticks, {result.agreed} outputs agree")
    typer.echo("bit-identical" if result.identical else f"first difference: {result.difference}")


def main() -> None:
    """The console script."""
    app()


if __name__ == "__main__":
    main()

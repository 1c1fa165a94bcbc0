"""`gcs-log`: what analysis says of a log (`report`, `check`, `picture`); `replay` and `whatif`, which need the cores;
`paper`.

Exit codes of `replay`: 0 bit-identical; 1 not; 2 no log, or one that cannot be replayed. Of `whatif`: 1 where the
recorded flight does not come back under its own law.
"""

import json
import re
from dataclasses import asdict
from math import inf
from pathlib import Path
from typing import Annotated

import typer

from analysis.cli import Json, LogPath, refusing
from analysis.cli import app as analysis_app
from wire.errors import error_text
from wire.process.program import Overwrite, print_json_error, program, progress_line
from wire.process.system import NOT_RIGHT

DIFFERENT = 1
DELAY = re.compile(r"\+?([0-9]*\.?[0-9]+) ?(ms|s)")

app = program(
    "Read flight logs.",
    "Exit codes: 0 well; 1 the flight did not end well (report), the log is damaged (check), or is not replayed bit by "
    "bit (replay), or does not come back (whatif); 2 no log.",
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
        with progress_line("gcs-log") as show:
            result = replay_log(read_log(log), show)
    except (OSError, LogError, ReplayError) as error:
        print_json_error(error_text(error))
        typer.secho(f"gcs-log: {error_text(error)}", fg="red", err=True)
        raise typer.Exit(NOT_RIGHT) from error
    if as_json:
        typer.echo(json.dumps(asdict(result) | {"identical": result.identical}, indent=2))
    else:
        typer.echo(f"{result.inputs} inputs, {result.ticks} ticks, {result.agreed} outputs agree")
        typer.echo("bit-identical" if result.identical else f"first difference: {result.difference}")
    if not result.identical:
        raise typer.Exit(DIFFERENT)


def _laws(incomplete: str) -> list[str]:
    """Names for the Tab key: presets, and Python files here."""
    from formation.control.presets import PRESETS
    from wire.process.program import starting

    return starting((*PRESETS, *(str(path) for path in Path().glob("*.py"))), incomplete)


@app.command()
def whatif(
    log: LogPath,
    law: Annotated[
        str | None,
        typer.Option(metavar="NAME|FILE.py", help="A control preset, an own law's name or file.", autocompletion=_laws),
    ] = None,
    gains: Annotated[
        Path | None, typer.Option(metavar="FILE.toml", help="Tables [law] and [observer], in place of the law's own.")
    ] = None,
    without: Annotated[str | None, typer.Option(metavar="BODY", help="Without this follower.")] = None,
    delay: Annotated[str, typer.Option(metavar="+20ms", help="Every frame arrives so much later.")] = "0s",
    rate: Annotated[float | None, typer.Option(min=1.0, metavar="HZ", help="Frames a second at most.")] = None,
    out: Annotated[
        Path | None, typer.Option(metavar="FILE", help="The page; without it whatif.html beside the log.")
    ] = None,
    overwrite: Overwrite = False,
    as_json: Json = False,
) -> None:
    """Fly a recorded flight again under another law, in the disturbance that the log shows. Exit code 1: under its own
    law it does not come back, or the other law failed."""
    from rich.console import Console

    from analysis.load import load
    from formation.codes import FlightResult
    from sim.research import whatif_page
    from sim.research.laws import chosen, flown_by
    from sim.research.reflight import Change
    from sim.research.whatif import what_if
    from wire.errors import ConfigError
    from wire.files import new_file
    from wire.logs.mcap_scan import LogError

    late = DELAY.fullmatch(delay.strip())
    if late is None:
        raise typer.BadParameter(f"--delay {delay}: a time such as +20ms or 0.02s is wanted")
    delay_s = float(late[1]) * (1e-3 if late[2] == "ms" else 1.0)
    try:
        if law is not None:
            chosen(law, gains).check()
        flight = load(log)
        name = law if gains is None or flight.run.lab is None else law or flown_by(flight.run.lab)
        change = Change(None if name is None else chosen(name, gains), without, delay_s, rate or inf)
        with progress_line("gcs-log") as show:
            result = what_if(flight, change, log.name, show)
        if not as_json:
            with new_file(out or log.with_name("whatif.html"), overwrite) as path:
                path.write_text(whatif_page.html(result), encoding="utf-8")
    except (OSError, LogError, ConfigError, ValueError) as error:
        print_json_error(error_text(error))
        typer.secho(f"gcs-log: {error_text(error)}", fg="red", err=True)
        raise typer.Exit(NOT_RIGHT) from error
    if as_json:
        typer.echo(result.to_json())
    else:
        whatif_page.print_what_if(result, Console())
        typer.echo(path)
    if not result.comes_back or result.result is FlightResult.LAW_FAILED:
        raise typer.Exit(DIFFERENT)


@app.command()
def paper(
    flights: Annotated[list[Path], typer.Argument(metavar="DIR...", help="Folders with flight.mcap, or logs.")],
    out: Annotated[Path, typer.Option("--out", metavar="DIR", help="Where to; made if need be.")] = Path("figures"),
    width: Annotated[float, typer.Option(min=30.0, metavar="MM", help="Of each figure; a column is 88.9.")] = 88.9,
    overwrite: Overwrite = False,
    as_json: Json = False,
) -> None:
    """Write a paper's figures (PDF, SVG), table, numbers, methods and citation, and the hashes of the logs."""
    from sim.research import publish
    from wire.files import new_folder

    with refusing():
        shown = [publish.shown(source) for source in flights]
        written = [str(path) for path in publish.write(shown, new_folder(out, overwrite), width)]
    typer.echo(json.dumps({"files": written}) if as_json else "\n".join(written))


def main() -> None:
    """The console script."""
    app()


if __name__ == "__main__":
    main()

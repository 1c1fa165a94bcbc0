"""`gcs-log report | list | check | audit | picture | compare | layout | export | identify`: what a log says; `import`
and `join`, which make logs of others.

Exit codes: 0 well; 1 the flight neither landed nor ended in the air as asked (`report`), or the log is damaged
(`check`); 2 no log, or an argument that cannot be used.
"""

import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from wire.errors import ConfigError, error_text
from wire.files import demand_absent, new_file, new_folder, write_edited
from wire.process.program import Overwrite, Program, print_json_error, progress_line
from wire.process.system import NOT_RIGHT, REJECTED

if TYPE_CHECKING:
    from analysis.catalogue import CatalogueRow
    from analysis.identify.vehicle import Identification


app = typer.Typer(cls=Program, no_args_is_help=True, pretty_exceptions_enable=False, rich_markup_mode=None)

IMPORTED_FILES = "Logs of ULog (.ulg), DataFlash (.bin), Crazyflie's SD card, rosbag2 (folder, .mcap, .db3), or CSV."
LogPath = Annotated[Path, typer.Argument(metavar="FLIGHT.MCAP", help="The flight's log.", show_default=False)]
Json = Annotated[bool, typer.Option("--json", help="Print it as JSON, and nothing else there.")]
Out = Annotated[
    Path | None, typer.Option("--out", metavar="FILE", help="Where to; without it report.html beside the log.")
]
ProfileOut = Annotated[Path | None, typer.Option("--write", metavar="FILE", help="Write a drone's profile as TOML.")]
Drone = Annotated[int | None, typer.Option("--sysid", help="Whose profile; without it the last drone's.")]
Base = Annotated[
    str | None,
    typer.Option(
        "--profile",
        help="A shipped vehicle, or a profile's TOML file, to start from; none: the flight's own, or paper_40g.",
    ),
]
PictureOut = Annotated[Path | None, typer.Option("--out", metavar="FILE", help="The picture; else beside the log.")]


@app.command()
def report(log: LogPath, out: Out = None, overwrite: Overwrite = False, as_json: Json = False) -> None:
    """Write one self-contained HTML page about a flight, and print its numbers. Exit code 1 where the flight was lost,
    cut or aborted, or its own law failed; the page is written all the same."""
    from rich.console import Console

    from analysis.console import print_summary
    from analysis.load import load_checked
    from analysis.metrics import summarise
    from analysis.report import write

    with refusing():
        flight, checked = load_checked(log)
        with new_file(out or log.with_name("report.html"), overwrite) as path:
            summary = summarise(flight, mcap=log, report=path)
            write(flight, summary, path, checked.damage)
    if as_json:
        typer.echo(summary.to_json())
    else:
        print_summary(summary, Console())
        _print_how_to_open(path)
    if not summary.outcome.is_good:
        typer.echo(f"gcs-log: {summary.outcome}", err=True)
        raise typer.Exit(REJECTED)


@app.command("list")
def list_flights(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Where the logs are, in folders of any depth.")] = Path(
        "runs"
    ),
    sqlite: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Write the table `flights` of an SQLite database, too.")
    ] = None,
    most: Annotated[
        str | None, typer.Option("--keep", metavar="SIZE", help="Delete the oldest whole logs beyond it: 20GB, 500MB.")
    ] = None,
    as_json: Json = False,
) -> None:
    """List the flights in a folder: date, lab, length, error, outcome, faults. Exit code 1: one is damaged."""
    import sqlite3
    from dataclasses import asdict

    from analysis.catalogue import CatalogueRow, catalogue, over, write_sqlite

    most_bytes = None if most is None else _bytes(most)
    rows: list[CatalogueRow] = []
    for row in catalogue(folder):
        rows.append(row)
        if not as_json:
            typer.echo(_catalogue_line(row))
    if not rows:
        print_json_error(f"{folder}: no log")
        typer.echo(f"gcs-log: {folder}: no log", err=True)
        raise typer.Exit(NOT_RIGHT)
    if sqlite is not None:
        try:
            write_sqlite(rows, sqlite)
        except sqlite3.Error as error:
            typer.echo(f"gcs-log: {sqlite}: {error}", err=True)
            raise typer.Exit(NOT_RIGHT) from error
    if as_json:
        typer.echo(json.dumps([asdict(row) for row in rows], allow_nan=False))
    for path in () if most_bytes is None else over(rows, most_bytes):
        path.unlink()
        typer.echo(f"deleted {path}", err=True)
    if any(row.damage for row in rows):
        raise typer.Exit(REJECTED)


def _bytes(size: str) -> float:
    units = {"KB": 1e3, "MB": 1e6, "GB": 1e9, "TB": 1e12}
    number, unit = size[:-2].strip(), size[-2:].upper()
    if unit not in units or not number.replace(".", "", 1).isdecimal():
        raise typer.BadParameter(f"{size!r}: 20GB, say", param_hint="--keep")
    return float(number) * units[unit]


def _catalogue_line(row: "CatalogueRow") -> str:
    damage = f"  damaged: {row.damage}" if row.damage else ""
    damage = "  not whole: it is being recorded, or what recorded it was killed" if row.unfinished else damage
    if row.outcome is None:
        return f"{row.path}{damage or '  no flight'}"
    error = "no formation" if row.formation_rms_m is None else f"{1e3 * row.formation_rms_m:6.2f} mm"
    faults = "" if not row.faults else f", {row.faults} fault{'s' if row.faults > 1 else ''}"
    date = (row.date or "").replace("T", " ")[:19]
    damage = f"  simulated: {row.simulated.replace('T', ' ')[:19]}{damage}" if row.simulated else damage
    shown = f"{date:19}  {row.lab or '':16.16}  {row.duration_s:7.1f} s  {error:12}  {row.outcome}{faults}"
    return f"{shown}  {row.path}{damage}"


@app.command()
def check(log: LogPath, as_json: Json = False) -> None:
    """Say what a log holds, and what is left of a truncated or damaged one."""
    from rich.console import Console

    from analysis import check as checking

    with refusing():
        found = checking.check(log)
    if as_json:
        typer.echo(found.to_json())
    else:
        checking.print_check(found, Console())
    if not found.complete:
        raise typer.Exit(REJECTED)


@app.command("import")
def import_logs(
    files: Annotated[list[Path], typer.Argument(metavar="FILE...", help=IMPORTED_FILES, show_default=False)],
    out: Annotated[Path, typer.Option("--out", metavar="FLIGHT.MCAP", help="The log to write; it may not be there.")],
    by: Annotated[
        Path | None, typer.Option("--map", metavar="MAP.TOML", help="Which column is what; known layouts need none.")
    ] = None,
    as_json: Json = False,
) -> None:
    """Make one of our logs of others': ULog, DataFlash, a Crazyflie's SD card, a bag of ROS 2, CSV. A file is a
    vehicle; several share one clock. Exit code 1 for a file that is damaged: nothing is written, or what was read."""
    from dataclasses import asdict

    from analysis.imports import cli as importing

    with refusing():
        _demand_new(out)
        with progress_line("gcs-log") as show:
            result = importing.import_files(files, out, by, show)
    typer.echo(json.dumps(asdict(result)) if as_json else result.text)
    for damage in result.damage:
        typer.echo(f"gcs-log: {damage}", err=True)
    if result.damage:
        raise typer.Exit(REJECTED)


@app.command()
def join(
    log: LogPath,
    files: Annotated[
        list[Path], typer.Argument(metavar="AUTOPILOT_LOG...", help="As import reads.", show_default=False)
    ],
    out: Annotated[Path, typer.Option("--out", metavar="JOINED.MCAP", help="The log to write; it may not be there.")],
    drone: Annotated[
        int | None, typer.Option("--sysid", help="Whose it is, where the autopilot's log does not say.")
    ] = None,
    by: Annotated[Path | None, typer.Option("--map", metavar="MAP.TOML", help="As of import.")] = None,
    as_json: Json = False,
) -> None:
    """Put autopilots' own logs on a flight's time axis, by TIMESYNC where it ran, else by the motion: the gyros' turns
    against the cameras'. Refused where the motion does not show it. Exit code 1 for a log that is damaged."""
    from dataclasses import asdict

    from analysis.imports import join as joining
    from analysis.imports.maps import read_map

    with refusing():
        _demand_new(out)
        with progress_line("gcs-log") as show:
            show(f"joining {', '.join(map(str, files))}")
            joined = joining.join(log, files, out, drone, None if by is None else read_map(by))
    if as_json:
        typer.echo(json.dumps({"file": str(out), "joined": [asdict(each) for each in joined]}))
    else:
        typer.echo("\n".join((*(each.text for each in joined), str(out))))
    for each in joined:
        if each.damage:
            typer.echo(f"gcs-log: {each.damage}", err=True)
    if any(each.damage for each in joined):
        raise typer.Exit(REJECTED)


def _demand_new(out: Path) -> None:
    """ConfigError where a log is there: what was imported is never written over."""
    if out.exists():
        raise ConfigError([f"{out}: it is there already, and nothing is written over it: name another"])


@app.command()
def audit(log: LogPath, as_json: Json = False) -> None:
    """List who asked for what, what was done to the lab's keys, and which packets and requests were rejected."""
    from dataclasses import asdict

    from analysis.check import audit as audit_log

    with refusing():
        rows = audit_log(log)
    if as_json:
        typer.echo(json.dumps([asdict(row) for row in rows]))
        return
    for row in rows:
        time = "before" if row.t_s is None else f"{row.t_s:.2f} s"
        typer.echo("  ".join(filter(None, (f"{time:>10}", f"{row.who:<28}", row.what, row.result))))


@app.command()
def picture(
    log: LogPath,
    gif: Annotated[bool, typer.Option("--gif", help="As an animation in 3-D instead, of at most 3 MB.")] = False,
    out: PictureOut = None,
    overwrite: Overwrite = False,
    as_json: Json = False,
) -> None:
    """Draw a flight on one sheet, as a PNG."""
    from analysis.animation import animation
    from analysis.picture import picture as draw_picture

    with refusing(), new_file(out or log.with_suffix(".gif" if gif else ".png"), overwrite) as path:
        (animation if gif else draw_picture)(log, path)
    typer.echo(json.dumps({"file": str(path)}) if as_json else path)


@app.command()
def compare(
    first: LogPath,
    second: LogPath,
    out: Annotated[
        Path | None, typer.Option("--out", metavar="FILE", help="The page; without it compared.html beside the first.")
    ] = None,
    overwrite: Overwrite = False,
    as_json: Json = False,
) -> None:
    """Hold two flights side by side: numbers, overlaid pictures, and what was not the same in their configuration. Exit
    code 1: the own law of one failed."""
    from rich.console import Console

    from analysis import compare as comparing

    with refusing():
        a, b = comparing.sides(first, second)
        if as_json:
            typer.echo(comparing.to_json(a, b))
        else:
            with new_file(out or first.with_name("compared.html"), overwrite) as path:
                path.write_text(comparing.html(a, b), encoding="utf-8")
            comparing.print_comparison(a, b, Console())
            typer.echo(path)  # for scripts
            _print_how_to_open(path)
    if a.summary.law_failures or b.summary.law_failures:
        raise typer.Exit(REJECTED)


@app.command()
def layout(
    source: Annotated[
        Path | None, typer.Argument(metavar="LAB.TOML|FLIGHT.MCAP", help="Whose drones; without it three usual ones.")
    ] = None,
    out: Annotated[Path, typer.Option("--out", metavar="FILE", help="A .json or .rbl file.")] = Path("foxglove.json"),
    overwrite: Overwrite = False,
    as_json: Json = False,
) -> None:
    """Write a layout of a formation flight for Foxglove (.json), or a blueprint for Rerun (.rbl)."""
    from analysis import layout as layouts

    with refusing(), new_file(out, overwrite) as path:
        layouts.write(path, source)
    typer.echo(json.dumps({"file": str(path)}) if as_json else path)


@app.command()
def export(
    log: LogPath,
    csv: Annotated[bool, typer.Option("--csv", help="Text that every program reads.")] = False,
    parquet: Annotated[bool, typer.Option("--parquet", help="Smaller and quicker; needs pyarrow.")] = False,
    rosbag2: Annotated[bool, typer.Option("--rosbag2", help="A bag of ROS 2, for `ros2 bag play`.")] = False,
    out: Annotated[
        Path | None, typer.Option("--out", metavar="FOLDER", help="Where to; without it a folder beside the log.")
    ] = None,
    overwrite: Overwrite = False,
    as_json: Json = False,
) -> None:
    """Write every topic as a table, one file each: every number as it was logged, a row a drone. Or a bag of ROS 2."""
    from analysis import rosbag2 as bag
    from analysis.tables import load, to_csv, to_parquet
    from wire.logs.mcap_read import read_log

    writers: dict[str, tuple[bool, Callable[[Path, Callable[[str], None]], list[Path]]]] = {
        "csv": (csv, lambda folder, show: to_csv(load(log), folder, show)),
        "parquet": (parquet, lambda folder, show: to_parquet(load(log), folder, show)),
        "rosbag2": (rosbag2, lambda folder, show: bag.write(read_log(log), folder, show)),
    }
    chosen = [(kind, write) for kind, (is_wanted, write) in writers.items() if is_wanted]
    if len(chosen) != 1:
        raise typer.BadParameter("say which: --csv, --parquet or --rosbag2")
    kind, write = chosen[0]
    with refusing():
        read_log(log)  # no folder is made for what is no log
        folder = new_folder(out or log.with_name(f"{log.stem}-{kind}"), overwrite)
        with progress_line("gcs-log") as show:
            written = write(folder, show)
    result = {"folder": str(folder), "files": [str(path) for path in written]}
    typer.echo(json.dumps(result) if as_json else f"{len(written)} files in {folder}")


@app.command()
def identify(
    log: LogPath,
    base: Base = None,
    write: ProfileOut = None,
    drone: Drone = None,
    overwrite: Overwrite = False,
    as_json: Json = False,
) -> None:
    """Estimate what the controller must know of each drone: response, thrust, noise, delay."""
    from rich.console import Console

    from analysis.identify import report as identified
    from analysis.identify import vehicle as identification
    from analysis.load import load
    from wire.config_file import vehicle_profile

    with refusing():
        if write is not None:
            demand_absent(write, overwrite)
        found = identification.identify(load(log), None if base is None else vehicle_profile(base))
        if write is not None:
            _write_profile(found, write, drone, overwrite)
    if as_json:
        typer.echo(identified.to_json(found))
    else:
        identified.print_identification(found, Console())


def _write_profile(found: "Identification", path: Path, sysid: int | None, overwrite: bool) -> None:
    """Write the profile of the drone of that sysid, or of the flight's last drone, a follower."""
    from analysis.identify.vehicle import KNOWN_WITHIN
    from wire.config_file import dump_profile
    from wire.logs.mcap_scan import LogError

    chosen = [drone for drone in found.drones if sysid in (None, drone.vehicle.sysid)]
    if not chosen:
        raise LogError(f"no drone {sysid} was sent targets in this flight" if sysid else "no drone was sent targets")
    drone = chosen[-1]
    write_edited(path, dump_profile(drone.profile(KNOWN_WITHIN)), overwrite)
    if unknown := drone.unknown():
        text = f"{path}: not known within a third, as before: {', '.join(unknown)}; {IDENTIFIED_BY}"
        typer.echo(f"gcs-log: {text}", err=True)


IDENTIFIED_BY = "identify a circle or an eight at speed for the response, a flight that climbs and sinks for the thrust"


def _print_how_to_open(path: Path) -> None:
    """Print, for people, on standard error, how to open the page."""
    typer.echo(f"open it in a browser: {path.resolve().as_uri()}", err=True)


@contextmanager
def refusing() -> Iterator[None]:
    """Turn what cannot be read or written into one line and exit code 2."""
    from analysis.imports.recording import BadFileError
    from wire.logs.mcap_scan import LogError

    try:
        yield
    except (OSError, LogError, ConfigError) as error:
        print_json_error(error_text(error))
        typer.echo(f"gcs-log: {error_text(error)}", err=True)
        raise typer.Exit(REJECTED if isinstance(error, BadFileError) else NOT_RIGHT) from error

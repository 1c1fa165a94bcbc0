"""The command line: `python -m bench.hummingbird`."""

from contextlib import nullcontext
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console
from rich.table import Table

from bench.command import FAILED, Json, Seeds
from sim.studies.runner import Runner
from wire.files import make_folder

if TYPE_CHECKING:
    from bench.hummingbird.flights import Benchmark


def main(
    seeds: Seeds = 1,
    log: Annotated[Path | None, typer.Option(metavar="FOLDER", help="Keep the logs of the flights here.")] = None,
    as_json: Json = False,
) -> None:
    """Fly line, circle and gust on rotorpy's physics, its Hummingbird; some minutes. Exit code 1 if any failed.

    Needs rotorpy: pip install 'mavlink-formation[rotorpy]'.
    """
    console = Console(stderr=as_json, markup=False)
    try:
        from bench.hummingbird import flights
    except ModuleNotFoundError as error:
        if error.name is None or error.name.partition(".")[0] != "rotorpy":
            raise
        raise typer.BadParameter("rotorpy is not here: pip install 'mavlink-formation[rotorpy]'") from error
    if log is not None:
        make_folder(log)
    with TemporaryDirectory() if log is None else nullcontext(log) as folder:
        jobs = flights.flights(range(1, seeds + 1), Path(folder))
        result = flights.benchmark(jobs, Runner(console).run("flights", flights.fly, jobs))
    if as_json:
        print(result.to_json())
    else:
        console.print(table(result))
    if result.landed < result.flights:
        raise typer.Exit(FAILED)


def table(result: "Benchmark") -> Table:
    """What was flown, in millimetres, with what was assumed above it."""
    a = result.assumed
    lines = [
        f"{result.vehicle} on rotorpy's physics, {result.seeds} seed(s), {result.landed} of {result.flights} landed",
        f"cameras {1e3 * a.mocap_delay_s:.0f} ms, link {1e3 * a.link_s:.0f} ms; "
        f"answer {1e3 * a.response_dead_time_s:.0f} ms dead, {1e3 * a.response_lag_s:.0f} ms lag",
    ]
    shown = Table(title="\n".join(lines), title_justify="left")
    for heading in ("", "RMS, mm", "vibration, mm", "mean of largest, mm", "largest, mm", "settling, s", "chatter, °"):
        shown.add_column(heading, justify="right" if heading else "left")
    shown.add_row("line", _mm(result.line_rms_m), _mm(result.line_vibration_m))
    shown.add_row("circle", _mm(result.circle_rms_m), _mm(result.circle_vibration_m))
    settle_s, chatter = ("-" if v is None else f"{v:.2f}" for v in (result.gust_settle_s, result.chatter_deg))
    gust = (_mm(result.gust_mean_dev_m), _mm(result.gust_max_dev_m))
    shown.add_row(f"gust of {result.wind_m_s:g} m/s", "", "", *gust, settle_s, chatter)
    return shown


def _mm(length_m: float | None) -> str:
    return "-" if length_m is None else f"{1e3 * length_m:.2f}"


if __name__ == "__main__":
    typer.run(main)

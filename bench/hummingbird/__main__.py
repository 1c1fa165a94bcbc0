"""The command line: `python -m bench.hummingbird`."""

from contextlib import nullcontext
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated

import typer
from rich.console import Console

from bench.command import FAILED, Seeds
from mavlink_formation.installation import install_command
from sim.runner import Runner
from wire.files import make_folder


def main(
    seeds: Seeds = 1,
    log: Annotated[Path | None, typer.Option(metavar="FOLDER", help="Keep the logs of the flights here.")] = None,
) -> None:
    """Fly line, circle and gust on rotorpy's physics, its Hummingbird; some minutes, JSON. Exit code 1 if any failed.

    Needs rotorpy: pip install 'mavlink-formation[rotorpy]'.
    """
    console = Console(stderr=True, markup=False)
    try:
        from bench.hummingbird import flights
    except ModuleNotFoundError as error:
        if error.name is None or error.name.partition(".")[0] != "rotorpy":
            raise
        raise typer.BadParameter(f"rotorpy is not here: {install_command('rotorpy')}") from error
    if log is not None:
        make_folder(log)
    with TemporaryDirectory() if log is None else nullcontext(log) as folder:
        jobs = flights.flights(range(1, seeds + 1), Path(folder))
        result = flights.benchmark(jobs, Runner(console).run("flights", flights.fly, jobs))
    print(result.to_json())
    if result.landed < result.flights:
        raise typer.Exit(FAILED)


if __name__ == "__main__":
    typer.run(main)

"""Fly the paper's experiments, for the manual's tables.

    python -m tools.figures.paper_tables                                  # everything, both vehicles
    python -m tools.figures.paper_tables --vehicle paper_40g --only cfc   # one row, and the mismatches with it

The figures go into docs/paper/VEHICLE.json. `make docs` makes the tables from there.
"""

import argparse
from pathlib import Path

from rich.console import Console

from formation.vehicle.profile import profile
from sim.studies import paper
from sim.studies.experiments import CONTROLLERS
from sim.studies.host import Host
from sim.studies.runner import Runner

ROOT = Path(__file__).parents[2]
VEHICLES = ("paper_40g", "paper_40g_printed")


def kept(vehicle: str) -> Path:
    """Where the figures of a vehicle are."""
    return ROOT / "docs" / "paper" / f"{vehicle}.json"


def fly(vehicle: str, seeds: int, only: tuple[str, ...], workers: int | None) -> None:
    """Fly the rows, and put them in the place of those that were flown before."""
    console = Console()
    flights = paper.jobs(range(1, seeds + 1), profile(vehicle), only, Host.LOCKSTEP)
    flown = paper.compare(flights, Runner(console, workers))
    if only != tuple(CONTROLLERS) and kept(vehicle).exists():
        flown = paper.merged(paper.from_json(kept(vehicle).read_text(encoding="utf-8")), flown)
    kept(vehicle).parent.mkdir(exist_ok=True)
    kept(vehicle).write_text(flown.to_json() + "\n", encoding="utf-8")


def main() -> None:
    """Read the command line, and fly."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--vehicle", choices=VEHICLES, action="append", help="this one alone")
    parser.add_argument("--only", choices=tuple(CONTROLLERS), action="append", help="this row alone")
    parser.add_argument("--seeds", type=int, default=paper.SEEDS)
    parser.add_argument("--workers", type=int, help="processes; without it one a core")
    asked = parser.parse_args()
    for vehicle in asked.vehicle or VEHICLES:
        fly(vehicle, asked.seeds, tuple(asked.only or CONTROLLERS), asked.workers)


if __name__ == "__main__":
    main()

"""Fly the paper's experiments, for the manual's tables.

    python -m tools.figures.paper_tables                                  # everything, both vehicles
    python -m tools.figures.paper_tables --vehicle paper_40g --only cfc   # one row, and the mismatches with it

The figures go into docs/paper/VEHICLE.json. `make docs` makes the tables from there.
"""

import argparse
import json
from dataclasses import replace
from pathlib import Path

from rich.console import Console

from formation.vehicle.profile import profile
from sim.research import paper
from sim.research.experiments import CONTROLLERS
from sim.research.host import Host
from sim.research.paper import Comparison, Figures, Mismatched
from sim.runner import Runner

ROOT = Path(__file__).parents[2]
VEHICLES = ("paper_40g", "paper_40g_printed")


def kept(vehicle: str) -> Path:
    """Where the figures of a vehicle are."""
    return ROOT / "docs" / "paper" / f"{vehicle}.json"


def from_json(text: str) -> Comparison:
    """The comparison that `to_json` wrote, without traces; ValueError where it is none."""
    try:
        values = json.loads(text)
        return Comparison(
            {name: Figures(**figures) for name, figures in values["controllers"].items()},
            {name: Mismatched(**figures) for name, figures in values["mismatches"].items()},
            values["vehicle"],
            float(values["gust_peak_m_s2"]),
            tuple(values["seeds"]),
            Host(values["host"]),
            {},
        )
    except (KeyError, TypeError, AttributeError, ValueError) as error:
        raise ValueError(f"no comparison of `gcs-sim paper`: {error}") from error


def merged(old: Comparison, new: Comparison) -> Comparison:
    """The old comparison with the rows of the new one in their places; ValueError if they were not flown alike."""
    for what in ("vehicle", "gust_peak_m_s2", "seeds", "host"):
        was, now = getattr(old, what), getattr(new, what)
        if was != now:
            raise ValueError(f"{what} was {was} and is {now} now: fly every controller again")
    rows = {**old.controllers, **new.controllers}
    return replace(
        new,
        controllers={name: rows[name] for name in CONTROLLERS if name in rows},
        mismatches=new.mismatches or old.mismatches,
    )


def fly(vehicle: str, seeds: int, only: tuple[str, ...], workers: int | None) -> None:
    """Fly the rows, and put them in the place of those that were flown before."""
    console = Console()
    flights = paper.jobs(range(1, seeds + 1), profile(vehicle), only, Host.LOCKSTEP)
    flown = paper.compare(flights, Runner(console, workers))
    if only != tuple(CONTROLLERS) and kept(vehicle).exists():
        flown = merged(from_json(kept(vehicle).read_text(encoding="utf-8")), flown)
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

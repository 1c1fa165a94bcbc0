"""Fly the paper's experiments and write their tables into README.md and docs/paper_vehicle.md.

    python tests/figures/paper_tables.py                                  # everything, both vehicles
    python tests/figures/paper_tables.py --vehicle paper_40g --only cfc   # one row, and the mismatches with it
    python tests/figures/paper_tables.py --written                        # the documents alone, from what was flown

What was flown is kept in docs/paper/VEHICLE.json, which the tests hold against the documents.
"""

import argparse
from pathlib import Path

from rich.console import Console

from formation.vehicle.profile import profile
from sim.studies import paper, paper_page
from sim.studies.experiments import CONTROLLERS
from sim.studies.runner import Runner

ROOT = Path(__file__).parents[2]
SHOWN = {"paper_40g": "README.md", "paper_40g_printed": "docs/paper_vehicle.md"}
"""The document with the tables of each vehicle."""


def kept(vehicle: str) -> Path:
    """Where the figures of a vehicle are."""
    return ROOT / "docs" / "paper" / f"{vehicle}.json"


def blocks(vehicle: str) -> dict[str, str]:
    """The tables of a vehicle by the name of their block."""
    comparison = paper.from_json(kept(vehicle).read_text(encoding="utf-8"))
    return {"paper": paper_page.markdown(comparison), "mismatches": paper_page.mismatch_markdown(comparison)}


def with_block(text: str, name: str, table: str) -> str:
    """The document with the table in its block."""
    begin, end = f"<!-- {name} -->\n", f"<!-- end of {name} -->"
    before, rest = text.split(begin)
    _, after = rest.split(end)
    return f"{before}{begin}{table}\n{end}{after}"


def fly(vehicle: str, seeds: int, only: tuple[str, ...], workers: int | None) -> None:
    """Fly the rows, and put them in the place of those that were flown before."""
    console = Console()
    flights = paper.jobs(range(1, seeds + 1), profile(vehicle), only)
    flown = paper.compare(flights, Runner(console, workers))
    if only != tuple(CONTROLLERS) and kept(vehicle).exists():
        flown = paper.merged(paper.from_json(kept(vehicle).read_text(encoding="utf-8")), flown)
    kept(vehicle).parent.mkdir(exist_ok=True)
    kept(vehicle).write_text(flown.to_json() + "\n", encoding="utf-8")


def write() -> None:
    """Every table into its document."""
    for vehicle, document in SHOWN.items():
        path = ROOT / document
        text = path.read_text(encoding="utf-8")
        for name, table in blocks(vehicle).items():
            text = with_block(text, name, table)
        path.write_text(text, encoding="utf-8")


def main() -> None:
    """Read the command line, fly, write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--vehicle", choices=tuple(SHOWN), action="append", help="this one alone")
    parser.add_argument("--only", choices=tuple(CONTROLLERS), action="append", help="this row alone")
    parser.add_argument("--seeds", type=int, default=paper.SEEDS)
    parser.add_argument("--workers", type=int, help="processes; without it one a core")
    parser.add_argument("--written", action="store_true", help="fly nothing")
    asked = parser.parse_args()
    if not asked.written:
        for vehicle in asked.vehicle or SHOWN:
            fly(vehicle, asked.seeds, tuple(asked.only or CONTROLLERS), asked.workers)
    write()


if __name__ == "__main__":
    main()

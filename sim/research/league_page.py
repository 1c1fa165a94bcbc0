"""The league for people: tables for a terminal, and one page; the best law of each scene is marked, whoever it is."""

from collections.abc import Iterable, Iterator, Sequence

import numpy as np
from rich import box
from rich.table import Table

from analysis import page
from analysis.page import Row as Line
from analysis.page import Section
from analysis.quantity import UNKNOWN, Quantity
from formation.codes import GOOD_RESULTS
from sim.research.league import Recorded, Result, Row, cost, versions

Flown = Sequence[tuple[Row, Result]]
COLUMNS = (
    Quantity("rms_m", "RMS", "mm", ".2f"),
    Quantity("max_m", "largest", "mm", ".1f"),
    Quantity("outside_share", "beyond 1 cm", "% of the time", ".1f"),
    Quantity("settle_s", "settling", "s", ".2f"),
    Quantity("chatter_deg", "chatter", "° a frame", ".3f"),
    Quantity("thrust_std", "spread of the thrust", "%", ".2f"),
    Quantity("cpu_us", "processor", "µs a drone and frame", ".0f"),
)
BEST = " ★"
ABREAST, ABREAST_ON_PAGE = 5, 8
"""Laws beside each other on a terminal of eighty characters, and on the page."""


def console_tables(flown: Flown) -> Iterator[Table]:
    """RMS by law and scene, a vehicle after the other, ABREAST laws a table."""
    for vehicle in dict.fromkeys(row.vehicle for row, _ in flown):
        for laws in _abreast(flown, ABREAST):
            table = Table(title=f"{vehicle}: RMS off the slot, mm", box=box.SIMPLE_HEAD)
            table.add_column("")
            for law in laws:
                table.add_column(law, justify="right")
            for scene in _scenes(flown, vehicle):
                table.add_row(scene, *_cells(flown, vehicle, scene, laws, COLUMNS[0]))
            table.add_row("best in", *(str(_wins(flown, vehicle, law)) for law in laws))
            yield table


def html(flown: Flown, recorded_m: Recorded | None = None) -> str:
    """The page: a section a vehicle, a table a figure; recorded_m: RMS of recorded flights, by method and scene."""
    laws, scenes = _abreast(flown, ABREAST_ON_PAGE), {row.scene for row, _ in flown}
    facts = ", ".join(f"{name} {value}" for name, value in versions().items())
    sections = [
        Section(
            vehicle,
            vehicle,
            f"A star marks the law with the smallest RMS of those that flew to the end.{_tuned(flown, vehicle)}",
            parts=[
                *(_figure(flown, vehicle, beside, column) for column in COLUMNS for beside in laws),
                _recorded(flown, vehicle, recorded_m or {}),
            ],
        )
        for vehicle in dict.fromkeys(row.vehicle for row, _ in flown)
    ]
    heading = f"{sum(map(len, laws))} laws in {len(scenes)} scenes"
    return page.render(title="A league of laws", kind="League", heading=heading, facts=facts, sections=sections)


def _recorded(flown: Flown, vehicle: str, recorded_m: Recorded) -> page.Table | None:
    """What the recordings' own methods flew, beside ours that are simulated."""
    head = ("recorded flights, RMS off the reference, mm", *(f"#{method}" for method in recorded_m))
    lines = [
        Line((scene, *(f"{1e3 * of[scene]:.0f}" if scene in of else UNKNOWN for of in recorded_m.values())))
        for scene in _scenes(flown, vehicle)
        if any(scene in of for of in recorded_m.values())
    ]
    return page.table(head, lines)


def _tuned(flown: Flown, vehicle: str) -> str:
    """Which laws flew with other options than their own; empty: none."""
    names = dict.fromkeys(row.law.label for row, _ in flown if row.vehicle == vehicle and row.law.law)
    return f" With options from a file: {', '.join(names)}; league.json has them." if names else ""


def _figure(flown: Flown, vehicle: str, laws: Sequence[str], column: Quantity) -> page.Table | None:
    """None where no scene has the figure."""
    head = (column.heading, *(f"#{law}" for law in laws))
    scenes = [
        scene
        for scene in _scenes(flown, vehicle)
        if any(getattr(result, column.field) is not None for result in _results(flown, vehicle, scene).values())
    ]
    return page.table(head, [Line((scene, *_cells(flown, vehicle, scene, laws, column))) for scene in scenes])


def _cells(flown: Flown, vehicle: str, scene: str, laws: Sequence[str], column: Quantity) -> Iterator[str]:
    here = _results(flown, vehicle, scene)
    for law in laws:
        result = here.get(law)
        if result is None:
            yield UNKNOWN
        elif result.outcome not in GOOD_RESULTS:
            yield result.outcome
        else:
            yield column.of(result) + (BEST if column is COLUMNS[0] and _best(here.values()) is result else "")


def _best(results: Iterable[Result]) -> Result | None:
    """The one that flew to its end with the smallest RMS."""
    return min((result for result in results if cost(result) < np.inf), key=cost, default=None)


def _wins(flown: Flown, vehicle: str, law: str) -> int:
    """In how many scenes it is the best."""
    count = 0
    for scene in _scenes(flown, vehicle):
        here = _results(flown, vehicle, scene)
        count += law in here and _best(here.values()) is here[law]
    return count


def _results(flown: Flown, vehicle: str, scene: str) -> dict[str, Result]:
    """What each law did with that vehicle in that scene."""
    return {row.law.label: result for row, result in flown if (row.vehicle, row.scene) == (vehicle, scene)}


def _abreast(flown: Flown, most: int) -> list[list[str]]:
    """The laws, so many beside each other at most."""
    laws = list(dict.fromkeys(row.law.label for row, _ in flown))
    return [laws[first : first + most] for first in range(0, len(laws), most)]


def _scenes(flown: Flown, vehicle: str) -> list[str]:
    return list(dict.fromkeys(row.scene for row, _ in flown if row.vehicle == vehicle))

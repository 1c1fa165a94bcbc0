"""The comparison on paper: its tables."""

import io

import pytest
from rich.console import Console

from analysis.plots.style import Missing
from sim.research import paper_figures, paper_page
from sim.research.experiments import CONTROLLERS
from sim.research.host import Host
from sim.research.mismatch import MISMATCHES
from sim.research.paper import Comparison, Figures, Mismatched


def figures(gust_m: float) -> Figures:
    return Figures(gust_m, 1.1 * gust_m, 0.5, 0.4, 0.08, 0.001, 0.0005, None, 0.0005, 0.3)


def comparison(*names: str, gust_m: float = 0.05, seeds: tuple[int, ...] = (1, 2)) -> Comparison:
    off = {name: Mismatched(gust_m, 2.0 * gust_m, 0.7, 0.3) for name in MISMATCHES} if "cfc" in names else {}
    return Comparison({name: figures(gust_m) for name in names}, off, "paper_40g", 7.57, seeds, Host.STUDY, {})


WHOLE = comparison(*CONTROLLERS)


def test_a_terminal_of_eighty_characters_shows_every_number() -> None:
    console = Console(width=80, file=io.StringIO(), record=True)
    for table in paper_page.console_tables(WHOLE):
        console.print(table)
    shown = console.export_text()
    assert "…" not in shown
    assert shown.count("55.0") == len(CONTROLLERS) + 1  # and as believed, beside the mismatches
    assert all(name in " ".join(shown.split()) for name in MISMATCHES)


@pytest.mark.parametrize("draw", [paper_figures.gust, paper_figures.formation, paper_figures.deviations])
def test_a_comparison_without_flights_says_so(draw):
    assert isinstance(draw({}), Missing)

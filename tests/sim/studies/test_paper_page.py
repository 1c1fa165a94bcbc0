"""The comparison on paper: its tables, what is kept of it, and a row flown again."""

import io
import json

import pytest
from rich.console import Console

from analysis.plots.paper import COLOURS, NAMES
from sim.studies import paper, paper_page
from sim.studies.experiments import CONTROLLERS
from sim.studies.mismatch import MISMATCHES
from sim.studies.paper import Comparison, Figures, Mismatched


def figures(gust_m: float) -> Figures:
    return Figures(gust_m, 1.1 * gust_m, 0.5, 0.4, 0.08, 0.001, 0.0005, None, 0.0005, 0.3, 0.2, 0.9, 0.1)


def comparison(*names: str, gust_m: float = 0.05, seeds: tuple[int, ...] = (1, 2)) -> Comparison:
    off = {name: Mismatched(gust_m, 2.0 * gust_m, 0.7, 0.3) for name in MISMATCHES} if "cfc" in names else {}
    return Comparison({name: figures(gust_m) for name in names}, off, "paper_40g", 7.57, seeds, {})


WHOLE = comparison(*CONTROLLERS)


def test_every_controller_has_a_name_and_a_colour() -> None:
    assert list(NAMES) == list(COLOURS) == list(CONTROLLERS)


def test_a_terminal_of_eighty_characters_shows_every_number() -> None:
    console = Console(width=80, file=io.StringIO(), record=True)
    for table in paper_page.console_tables(WHOLE):
        console.print(table)
    shown = console.export_text()
    assert "…" not in shown
    assert shown.count("55.0") == len(CONTROLLERS) + 1  # and as believed, beside the mismatches
    assert all(name in " ".join(shown.split()) for name in MISMATCHES)


def test_the_markdown_is_a_table_with_the_papers_figures_in_brackets() -> None:
    head, rule, *rows = paper_page.markdown(WHOLE).splitlines()
    assert len({line.count("|") for line in (head, rule, *rows)}) == 1
    assert len(rows) == len(CONTROLLERS)
    assert rows[1].startswith("| ISTSMC, printed gains | 50.0 (300) | 55.0 |")
    assert rows[4].startswith("| **CFC, as shipped** |")
    assert " | 1.00 (70) | 0.50 | - (60) | " in rows[0]
    named = [line.split(" | ")[0] for line in paper_page.mismatch_markdown(WHOLE).splitlines()[2:]]
    assert named == [f"| {name}" for name in ("as believed", *MISMATCHES)]


def test_what_is_kept_comes_back() -> None:
    assert paper.from_json(WHOLE.to_json()) == WHOLE
    for broken in ("{}", "[]", "nothing", json.dumps({"controllers": {"cfc": {"speed": 1}}})):
        with pytest.raises(ValueError, match=r"no comparison of `gcs-sim paper`"):
            paper.from_json(broken)


def test_a_row_flown_again_takes_its_place_and_the_mismatches_with_it() -> None:
    again = paper.merged(WHOLE, comparison("cfc", gust_m=0.02))
    assert list(again.controllers) == list(CONTROLLERS)
    assert again.controllers["cfc"].gust_mean_dev_m == 0.02
    assert again.controllers["pid"].gust_mean_dev_m == 0.05
    assert again.mismatches["half delay"].gust_mean_dev_m == 0.02
    assert paper.merged(WHOLE, comparison("pid")).mismatches == WHOLE.mismatches


def test_rows_that_were_flown_otherwise_are_not_mixed() -> None:
    with pytest.raises(ValueError, match=r"seeds was \(1, 2\) and is \(1, 2, 3\) now"):
        paper.merged(WHOLE, comparison("cfc", seeds=(1, 2, 3)))


def test_the_page_has_the_tables_of_what_was_flown() -> None:
    html = paper_page.html(WHOLE)
    assert all(name in html for name in (*NAMES.values(), *MISMATCHES))
    assert "weak motors" not in paper_page.html(comparison("pid"))

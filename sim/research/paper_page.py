"""The comparison for people: tables for terminal and Markdown; a page with the counterparts of Figures 5 to 7."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from rich import box
from rich.table import Table

from analysis import page
from analysis.page import Section
from analysis.plots import style
from analysis.plots.style import Drawing, Missing
from analysis.quantity import Quantity
from formation.control.gains import SlidingGains
from formation.control.presets import PAPER_CFC, PAPER_ISTSMC, PAPER_SMC
from formation.vehicle.body import GRAVITY_M_S2
from formation.vehicle.profile import PAPER_40G_PRINTED
from sim.research import paper_figures as figures
from sim.research.experiments import Experiment
from sim.research.paper import REPORTED, SHIPPED, SHOWN, Comparison, Figures, Mismatched
from sim.research.paper_figures import NAMES, Traces
from sim.research.publish import save, tabular

COLUMNS = (
    Quantity("gust_mean_dev_m", "gust: mean of largest", "mm", ".1f"),
    Quantity("gust_max_dev_m", "gust: largest", "mm", ".1f"),
    Quantity("gust_settle_s", "gust: settling", "s", ".2f"),
    Quantity("gust_z3_share", "gust: Z3 error", "% of push", ".1f"),
    Quantity("line_vibration_m", "line: vibration", "mm", ".2f"),
    Quantity("line_rms_m", "line: RMS", "mm", ".2f"),
    Quantity("circle_vibration_m", "circle: vibration", "mm", ".2f"),
    Quantity("circle_rms_m", "circle: RMS", "mm", ".2f"),
    Quantity("chatter_deg", "chatter", "°", ".2f"),
)
MISMATCH_COLUMNS = tuple(column for column in COLUMNS if column.field in Mismatched.__dataclass_fields__)
NOMINAL = "as believed"
ABREAST = 4
"""Controllers beside each other on a terminal of eighty characters."""
Cells = list[tuple[str, ...]]
"""A table of texts, its head first."""


def console_tables(comparison: Comparison) -> list[Table]:
    """The comparison for a terminal of eighty characters: a controller a column, and the mismatches a row each."""
    tables: list[Table] = []
    for first in range(1, len(comparison.controllers) + 1, ABREAST):
        turned = zip(*_controllers(comparison), strict=True)
        (_, *names), *rows = ((row[0], *row[first : first + ABREAST]) for row in turned)
        table = Table(title=None if tables else explained(comparison), box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0))
        table.add_column("", no_wrap=True)
        for name in names:
            table.add_column(name, justify="right", min_width=max(map(len, name.split())))
        for row in rows:
            table.add_row(*row)
        tables.append(table)
    if comparison.mismatches:
        (_, *head), *rows = _vehicles(comparison)
        table = Table(title=f"{NAMES[SHIPPED]}, on a vehicle that is not as believed", box=box.SIMPLE_HEAD)
        table.add_column("")
        for heading in head:
            table.add_column(heading, justify="right")
        for row in rows:
            table.add_row(*row)
        tables.append(table)
    return tables


def markdown(comparison: Comparison) -> str:
    """The tables of controllers and mismatches for a document."""
    texts = []
    for head, *rows in (_controllers(comparison), _vehicles(comparison)):
        lines = (head, ("---",) * len(head), *rows)
        texts.append("\n".join(f"| {' | '.join(cells)} |" for cells in lines))
    return "\n\n".join(texts).replace(f"| {NAMES[SHIPPED]} |", f"| **{NAMES[SHIPPED]}** |")


def html(comparison: Comparison) -> str:
    """The page."""
    gust, *formed = drawings(comparison).values()
    sections = [
        Section(
            "table", "Controllers in one loop", explained(comparison), parts=(_page_table(_controllers(comparison)),)
        ),
        *_mismatch_section(comparison),
        Section("gust", "Gust (Figure 5)", "Deviation from hover in the swept fan.", (gust,)),
        Section("line", "Line (Figure 6)", "", formed[:2]),
        Section("circle", "Circle (Figure 7)", "", formed[2:]),
    ]
    title = "The paper's experiments"
    return page.render(title=title, kind="Controllers compared", heading=title, facts="", sections=sections)


def drawings(comparison: Comparison) -> dict[str, Drawing]:
    """The paper's figures, by what their files are called."""
    gust, line, circle = (_traces(comparison, experiment) for experiment in SHOWN)
    with style.styled():
        return {
            "figure-5": figures.gust(gust),
            "figure-6": figures.formation(line),
            "figure-6-error": figures.deviations(line),
            "figure-7": figures.formation(circle),
            "figure-7-error": figures.deviations(circle),
        }


def publish(comparison: Comparison, folder: Path) -> None:
    """Write the figures (PDF, SVG) and the tables (LaTeX) into a folder of this run's; OSError."""
    for name, drawing in drawings(comparison).items():
        if not isinstance(drawing, Missing):
            save(drawing, folder / name)
    head, *rows = zip(*_controllers(comparison), strict=True)
    tables = {
        "table-1": tabular(("parameter", "value"), _table_1()),
        "table-2": tabular(("law", "parameters"), _table_2()),
        "results": tabular(head, rows),
    }
    for name, text in tables.items():
        (folder / f"{name}.tex").write_text(text, encoding="utf-8")


def _table_1() -> Iterator[tuple[str, str]]:
    """The vehicle as printed."""
    vehicle = PAPER_40G_PRINTED
    yield "mass, kg", f"{vehicle.mass_kg:g}"
    yield "gravity, m/s²", f"{GRAVITY_M_S2:g}"
    for axis, inertia in zip(("xx", "yy", "zz"), vehicle.inertia_kg_m2, strict=True):
        yield f"J{axis}, kg m²", f"{inertia:.4g}"
    yield "wheelbase, m", f"{vehicle.wheelbase_m:g}"


def _table_2() -> Iterator[tuple[str, str]]:
    """The gains as printed."""
    smc, istsmc, observer = PAPER_SMC.follower, PAPER_ISTSMC.follower, PAPER_CFC.observer
    assert isinstance(smc, SlidingGains)
    assert isinstance(istsmc, SlidingGains)
    yield "SMC", f"c = {smc.c:g}, k = {smc.k:g}"
    yield "ISTSMC", f"c = {istsmc.c:g}, p1 = {istsmc.p1:g}, p2 = {istsmc.p2:g}, ε = {istsmc.eps:g}"
    yield "FTESO", f"ω = {observer.bandwidth_rad_s:g} rad/s, α = {observer.alpha:.3g}"


def explained(comparison: Comparison) -> str:
    """What was flown."""
    return (
        f"{comparison.vehicle}, median of {len(comparison.seeds)} seeds, flown {comparison.host.text}; in brackets "
        f"what the paper reports of its hardware. The fan pushes with {comparison.gust_peak_m_s2:.2f} m/s² at most: "
        "in the mean over its passes the printed ISTSMC alone deviates by 0.30 m."
    )


def _controllers(comparison: Comparison) -> Cells:
    """A controller a row: our medians and, in brackets, what the paper reports."""
    head = ("controller", *(column.heading for column in COLUMNS))
    return [head, *((NAMES[name], *_cells(name, numbers)) for name, numbers in comparison.controllers.items())]


def _vehicles(comparison: Comparison) -> Cells:
    """A vehicle a row, the one as believed first."""
    shipped = comparison.controllers.get(SHIPPED)
    flown = {**({} if shipped is None else {NOMINAL: shipped}), **comparison.mismatches}
    head = ("vehicle", *(column.heading for column in MISMATCH_COLUMNS))
    return [head, *((name, *(column.of(of) for column in MISMATCH_COLUMNS)) for name, of in flown.items())]


def _page_table(cells: Cells) -> page.Table | None:
    (first, *numbers), *rows = cells
    return page.table((first, *(f"#{heading}" for heading in numbers)), rows)


def _mismatch_section(comparison: Comparison) -> list[Section]:
    if not comparison.mismatches:
        return []
    lead = f"{NAMES[SHIPPED]}, in the gust on a vehicle that is not as it believes."
    return [Section("mismatch", "Other vehicles than believed", lead, parts=(_page_table(_vehicles(comparison)),))]


def _cells(name: str, numbers: Figures) -> Iterator[str]:
    for column in COLUMNS:
        reported = REPORTED.get(name, {}).get(column.field)
        brackets = "" if reported is None else f" ({replace(column, form='g').text(reported)})"
        yield column.of(numbers) + brackets


def _traces(comparison: Comparison, experiment: Experiment) -> Traces:
    """One experiment's traces by controller, in the table's order."""
    found = ((name, comparison.traces.get((name, experiment))) for name in comparison.controllers)
    return {name: trace for name, trace in found if trace is not None}

"""The comparison for people: tables for terminal and Markdown; a page with the counterparts of Figures 5 to 7."""

from collections.abc import Iterator, Mapping
from pathlib import Path

from rich import box
from rich.table import Table

from analysis import page
from analysis.page import Section
from analysis.plots import paper as figures
from analysis.plots import style
from analysis.plots.paper import NAMES, Traces
from analysis.plots.style import Drawing, Missing
from analysis.publish import save, tabular
from formation.control.gains import SlidingGains
from formation.control.presets import PAPER_CFC, PAPER_ISTSMC, PAPER_SMC
from formation.vehicle.body import GRAVITY_M_S2
from formation.vehicle.profile import PAPER_40G_PRINTED
from sim.studies.experiments import Experiment
from sim.studies.paper import REPORTED, SHIPPED, Comparison, Figures, Mismatched
from wire.files import make_folder

COLUMNS = (
    ("gust_mean_dev_m", "gust: mean of largest, mm", 1e3, 1),
    ("gust_max_dev_m", "gust: largest, mm", 1e3, 1),
    ("gust_settle_s", "gust: settling, s", 1.0, 2),
    ("gust_z3_share", "gust: Z3 error, % of push", 1e2, 1),
    ("line_vibration_m", "line: vibration, mm", 1e3, 2),
    ("line_rms_m", "line: RMS, mm", 1e3, 2),
    ("circle_vibration_m", "circle: vibration, mm", 1e3, 2),
    ("circle_rms_m", "circle: RMS, mm", 1e3, 2),
    ("chatter_deg", "chatter, °", 1.0, 2),
    ("push_swing_deg", "push: swing, °", 1.0, 2),
    ("push_settle_s", "push: settling, s", 1.0, 2),
    ("push_deviation_m", "push: largest, mm", 1e3, 0),
)
"""Field of `Figures`, heading, factor, digits."""
MISMATCH_COLUMNS = tuple(column for column in COLUMNS if column[0] in Mismatched.__dataclass_fields__)
NOMINAL = "as believed"
ABREAST = 4
"""Controllers beside each other on a terminal of eighty characters."""


def console_tables(comparison: Comparison) -> list[Table]:
    """The comparison for a terminal of eighty characters: a controller a column, and the mismatches a row each."""
    names = list(comparison.controllers)
    tables: list[Table] = []
    for first in range(0, len(names), ABREAST):
        abreast = names[first : first + ABREAST]
        table = Table(title=None if tables else explained(comparison), box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0))
        table.add_column("", no_wrap=True)
        for name in abreast:
            table.add_column(NAMES[name], justify="right", min_width=max(map(len, NAMES[name].split())))
        cells = zip(*(_cells(name, comparison.controllers[name]) for name in abreast), strict=True)
        for (_, heading, _, _), row in zip(COLUMNS, cells, strict=True):
            table.add_row(heading, *row)
        tables.append(table)
    if comparison.mismatches:
        table = Table(title=f"{NAMES[SHIPPED]}, on a vehicle that is not as believed", box=box.SIMPLE_HEAD)
        for heading in ("", *(heading for _, heading, _, _ in MISMATCH_COLUMNS)):
            table.add_column(heading, justify="right" if heading else "left")
        for name, numbers in _mismatches(comparison).items():
            table.add_row(name, *(_text(numbers, column) for column in MISMATCH_COLUMNS))
        tables.append(table)
    return tables


def markdown(comparison: Comparison) -> str:
    """The table of controllers for a document."""
    rows = [
        (f"**{NAMES[name]}**" if name == SHIPPED else NAMES[name], *_cells(name, numbers))
        for name, numbers in comparison.controllers.items()
    ]
    return _markdown(("controller", *(heading for _, heading, _, _ in COLUMNS)), rows)


def mismatch_markdown(comparison: Comparison) -> str:
    """The table of mismatches for a document."""
    rows = [
        (name, *(_text(numbers, column) for column in MISMATCH_COLUMNS))
        for name, numbers in _mismatches(comparison).items()
    ]
    return _markdown(("vehicle", *(heading for _, heading, _, _ in MISMATCH_COLUMNS)), rows)


def _markdown(head: tuple[str, ...], rows: list[tuple[str, ...]]) -> str:
    return "\n".join(f"| {' | '.join(cells)} |" for cells in (head, *rows)).replace(
        "\n", "\n|" + "---|" * len(head) + "\n", 1
    )


def html(comparison: Comparison) -> str:
    """The page."""
    rows = [(NAMES[name], *_cells(name, numbers)) for name, numbers in comparison.controllers.items()]
    table = page.table(["controller", *(f"#{heading}" for _, heading, _, _ in COLUMNS)], rows)
    gust, *formed = drawings(comparison).values()
    sections = [
        Section("table", "Controllers in one loop", explained(comparison), parts=(table,)),
        *_mismatch_section(comparison),
        Section("gust", "Gust (Figure 5)", "Deviation from hover in the swept fan.", (gust,)),
        Section("line", "Line (Figure 6)", "", formed[:2]),
        Section("circle", "Circle (Figure 7)", "", formed[2:]),
    ]
    title = "The paper's experiments"
    return page.render(title=title, kind="Controllers compared", heading=title, facts="", sections=sections)


def drawings(comparison: Comparison) -> dict[str, Drawing]:
    """The paper's figures, by what their files are called."""
    gust, line, circle = (
        _traces(comparison, experiment) for experiment in (Experiment.GUST, Experiment.LINE, Experiment.CIRCLE)
    )
    with style.styled():
        return {
            "figure-5": figures.gust(gust),
            "figure-6": figures.formation(line),
            "figure-6-error": figures.deviations(line),
            "figure-7": figures.formation(circle),
            "figure-7-error": figures.deviations(circle),
        }


def publish(comparison: Comparison, folder: Path) -> None:
    """Write the figures (PDF, SVG) and the tables (LaTeX) into a folder, which is made; OSError."""
    make_folder(folder)
    for name, drawing in drawings(comparison).items():
        if not isinstance(drawing, Missing):
            save(drawing, folder / name)
    cells = zip(*(_cells(name, numbers) for name, numbers in comparison.controllers.items()), strict=True)
    rows = [(heading, *row) for (_, heading, _, _), row in zip(COLUMNS, cells, strict=True)]
    tables = {
        "table-1": tabular(("parameter", "value"), _table_1()),
        "table-2": tabular(("law", "parameters"), _table_2()),
        "results": tabular(("", *(NAMES[name] for name in comparison.controllers)), rows),
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


def _mismatches(comparison: Comparison) -> Mapping[str, Figures | Mismatched]:
    """The vehicle as believed first."""
    shipped = comparison.controllers.get(SHIPPED)
    return {**({} if shipped is None else {NOMINAL: shipped}), **comparison.mismatches}


def _mismatch_section(comparison: Comparison) -> list[Section]:
    if not comparison.mismatches:
        return []
    rows = [
        (name, *(_text(numbers, column) for column in MISMATCH_COLUMNS))
        for name, numbers in _mismatches(comparison).items()
    ]
    head = ["vehicle", *(f"#{heading}" for _, heading, _, _ in MISMATCH_COLUMNS)]
    lead = f"{NAMES[SHIPPED]}, in the gust on a vehicle that is not as it believes."
    return [Section("mismatch", "Other vehicles than believed", lead, parts=(page.table(head, rows),))]


def _cells(name: str, numbers: Figures) -> list[str]:
    """One row of the table: our median and, where the paper reports one, its figure in brackets."""
    texts = []
    for column in COLUMNS:
        field, _, factor, _ = column
        reported = REPORTED.get(name, {}).get(field)
        text = _text(numbers, column)
        texts.append(text if reported is None else f"{text} ({factor * reported:g})")
    return texts


def _text(numbers: Figures | Mismatched, column: tuple[str, str, float, int]) -> str:
    field, _, factor, digits = column
    value: float | None = getattr(numbers, field)
    return "-" if value is None else f"{factor * value:.{digits}f}"


def _traces(comparison: Comparison, experiment: Experiment) -> Traces:
    """One experiment's traces by controller, in the table's order."""
    found = ((name, comparison.traces.get((name, experiment))) for name in comparison.controllers)
    return {name: trace for name, trace in found if trace is not None}

"""The comparison for people: a table for the terminal; a page with the counterparts of the paper's Figures 5 to 7."""

from rich import box
from rich.table import Table

from analysis import page
from analysis.page import Section
from analysis.plots import paper as figures
from analysis.plots import style
from analysis.plots.paper import NAMES, Traces
from sim.studies.experiments import Experiment
from sim.studies.paper import REPORTED, Comparison, Figures

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
)
"""Field of `Figures`, heading, factor, digits."""


def console_table(comparison: Comparison) -> Table:
    """The comparison for a terminal, a controller a column: so it fits one of eighty characters."""
    table = Table(title=_explained(comparison), box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0))
    table.add_column("", no_wrap=True)
    for name in comparison.controllers:
        table.add_column(NAMES[name], justify="right", min_width=max(map(len, NAMES[name].split())))
    cells = zip(*(_cells(name, numbers) for name, numbers in comparison.controllers.items()), strict=True)
    for (_, heading, _, _), row in zip(COLUMNS, cells, strict=True):
        table.add_row(heading, *row)
    return table


def html(comparison: Comparison) -> str:
    """The page."""
    rows = [
        page.row(page.cell(NAMES[name]), *(page.cell(words, "number") for words in _cells(name, numbers)))
        for name, numbers in comparison.controllers.items()
    ]
    head = ["controller", *(f"#{heading}" for _, heading, _, _ in COLUMNS)]
    table = Section("table", "Six controllers in one loop", _explained(comparison), (page.table(head, rows),))
    gust, line, circle = (_traces(comparison, experiment) for experiment in Experiment)
    with style.styled():
        sections = [
            table,
            _section("gust", "Gust (Figure 5)", "Deviation from hover in the swept fan.", figures.gust(gust)),
            _section("line", "Line (Figure 6)", "", figures.formation(line), figures.deviations(line)),
            _section("circle", "Circle (Figure 7)", "", figures.formation(circle), figures.deviations(circle)),
        ]
    body = "<h1>The paper's experiments</h1>" + "".join(section.html() for section in sections)
    return page.document("The paper's experiments", body)


def _explained(comparison: Comparison) -> str:
    return (
        f"Median of {len(comparison.seeds)} seeds; in brackets what the paper reports of its hardware. The fan pushes "
        f"with {comparison.gust_peak_m_s2:.2f} m/s² at most: so that the printed ISTSMC alone deviates by 0.30 m."
    )


def _cells(name: str, numbers: Figures) -> list[str]:
    """One row of the table: our median and, where the paper reports one, its figure in brackets."""
    texts = []
    for field, _, factor, digits in COLUMNS:
        value: float | None = getattr(numbers, field)
        reported = REPORTED.get(name, {}).get(field)
        text = "-" if value is None else f"{factor * value:.{digits}f}"
        texts.append(text if reported is None else f"{text} ({factor * reported:g})")
    return texts


def _traces(comparison: Comparison, experiment: Experiment) -> Traces:
    """One experiment's traces by controller, in the table's order."""
    found = ((name, comparison.traces.get((name, experiment))) for name in comparison.controllers)
    return {name: trace for name, trace in found if trace is not None}


def _section(anchor: str, title: str, lead: str, *drawings: style.Drawing) -> Section:
    return Section(anchor, title, lead, tuple(page.picture(drawing) for drawing in drawings))

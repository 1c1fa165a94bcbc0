"""The comparison as a page: the table, and the counterparts of the paper's Figures 5, 6 and 7."""

import numpy as np
from rich.table import Table

from analysis import page
from analysis.page import Section
from analysis.plots import style
from analysis.plots.style import Drawing, Missing
from sim.experiments import Experiment, Trace
from sim.paper import REPORTED, Comparison, Figures

TITLES = {
    "smc": "SMC, printed gains",
    "istsmc": "ISTSMC, printed gains",
    "cfc_paper": "CFC, printed gains",
    "cfc": "CFC, shipped",
    "pid": "cascade PID",
    "geometric": "geometric SE(3)",
}
COLUMNS = (
    ("gust_max_dev_m", "gust: max deviation, mm", 1e3, 1),
    ("gust_settle_s", "gust: settling, s", 1.0, 2),
    ("gust_z3_rms_error_m_s2", "gust: Z3 error, m/s²", 1.0, 2),
    ("line_vibration_m", "line: vibration, mm", 1e3, 2),
    ("line_rms_m", "line: RMS, mm", 1e3, 2),
    ("circle_vibration_m", "circle: vibration, mm", 1e3, 2),
    ("circle_rms_m", "circle: RMS, mm", 1e3, 2),
    ("chatter_deg", "chatter, °", 1.0, 2),
)
"""Field of `Figures`, heading, factor, digits."""

SHOWN = (("smc", "#b5459b"), ("istsmc", "#e8772e"), ("cfc_paper", "#2a9d6f"), ("cfc", "#1f77d0"))
NO_TRACE = "the flight that this picture shows was not flown"


def cells(name: str, figures: Figures) -> list[str]:
    """One row of the table: our median and, where the paper reports one, its figure in brackets."""
    texts = []
    for field, _, factor, digits in COLUMNS:
        value: float | None = getattr(figures, field)
        reported = REPORTED.get(name, {}).get(field)
        text = "-" if value is None else f"{factor * value:.{digits}f}"
        texts.append(text if reported is None else f"{text} ({factor * reported:g})")
    return texts


def console_table(comparison: Comparison) -> Table:
    """The comparison for a terminal."""
    table = Table(title=f"median of {len(comparison.seeds)} seeds; in brackets what the paper reports of its hardware")
    table.add_column("controller")
    for _, heading, _, _ in COLUMNS:
        table.add_column(heading, justify="right")
    for name, figures in comparison.controllers.items():
        table.add_row(TITLES[name], *cells(name, figures))
    return table


def html(comparison: Comparison) -> str:
    """The page."""
    rows = [
        page.row(page.cell(TITLES[name]), *(page.cell(text, "number") for text in cells(name, figures)))
        for name, figures in comparison.controllers.items()
    ]
    head = ["controller", *(f"#{heading}" for _, heading, _, _ in COLUMNS)]
    table = Section(
        "table",
        "Six controllers in one loop",
        f"Median of {len(comparison.seeds)} seeds; in brackets what the paper reports of its hardware. The fan pushes "
        f"with {comparison.gust_peak_m_s2:.2f} m/s² at most: so that the printed ISTSMC alone deviates by 0.30 m.",
        (page.table(head, rows),),
    )
    with style.styled():
        figures = [
            Section("gust", "Gust (Figure 5)", "Deviation in the swept fan, and Z3 against the true push.",
                    (page.picture(_gust(comparison)), page.picture(_observer(comparison)))),
            Section("line", "Line (Figure 6)", "Paths seen from above, and the first follower's error in y.",
                    (page.picture(_paths(comparison, Experiment.LINE)),
                     page.picture(_errors(comparison, Experiment.LINE)))),
            Section("circle", "Circle (Figure 7)", "Paths seen from above, and the first follower's error in y.",
                    (page.picture(_paths(comparison, Experiment.CIRCLE)),
                     page.picture(_errors(comparison, Experiment.CIRCLE)))),
        ]  # fmt: skip
    body = "<h1>The paper's experiments</h1>" + "".join(section.html() for section in (table, *figures))
    return page.document("The paper's experiments", body)


def _traces(comparison: Comparison, experiment: Experiment) -> list[tuple[str, str, Trace]]:
    """Name, colour and trace of the controllers the figures show."""
    found = ((name, colour, comparison.traces.get((name, experiment))) for name, colour in SHOWN)
    return [(name, colour, trace) for name, colour, trace in found if trace is not None and len(trace.t_s)]


def _gust(comparison: Comparison) -> Drawing:
    """Deviation in x and y over time."""
    traces = _traces(comparison, Experiment.GUST)
    if not traces:
        return Missing(NO_TRACE)
    fig, grid = style.Sheet(4.2, (1.0, 1.0)).axes()
    for axis, (ax,) in enumerate(grid):
        for name, colour, trace in traces:
            style.line(ax, trace.t_s, trace.error_m[:, 0, axis], color=colour, lw=1.1, label=TITLES[name])
        ax.set_ylabel("xy"[axis] + " deviation, m")
        style.time_axis(ax, 0.0, float(traces[0][2].t_s[-1]), label=axis == 1)
    style.legend(grid[0][0])
    return fig


def _observer(comparison: Comparison) -> Drawing:
    """Z3 of the printed and the shipped observer against the true push along x."""
    traces = [found for found in _traces(comparison, Experiment.GUST) if found[0] in ("cfc_paper", "cfc")]
    if not traces:
        return Missing(NO_TRACE)
    fig, ((ax,),) = style.Sheet(2.8).axes()
    for name, colour, trace in traces:
        style.line(ax, trace.t_s, trace.z3_m_s2, color=colour, lw=1.0, label=f"Z3, {TITLES[name]}")
    last = traces[-1][2]
    style.line(ax, last.t_s, last.gust_m_s2, color=style.INK, lw=1.2, ls=(0, (4, 2)), label="true push")
    ax.set_ylabel("along x, m/s²")
    style.time_axis(ax, 0.0, float(last.t_s[-1]))
    style.legend(ax)
    return fig


def _paths(comparison: Comparison, experiment: Experiment) -> Drawing:
    """Leader and followers from above: the printed SMC, the printed CFC, the shipped CFC."""
    found = {name: (colour, trace) for name, colour, trace in _traces(comparison, experiment)}
    names = [name for name in ("smc", "cfc_paper", "cfc") if name in found]
    if not names:
        return Missing(NO_TRACE)
    fig, (row,) = style.Sheet(3.6, (1.0,), (1.0,) * len(names), share_y=True).axes()
    for ax, name in zip(row, names, strict=True):
        colour, trace = found[name]
        ax.plot(trace.path_m[:, 0, 0], trace.path_m[:, 0, 1], color=style.LEADER, lw=1.2)
        ax.plot(trace.path_m[:, 1:, 0], trace.path_m[:, 1:, 1], color=colour, lw=0.9)
        ax.set_title(TITLES[name])
        ax.set_aspect("equal", adjustable="box")
        ax.set_xlabel("x, m")
    row[0].set_ylabel("y, m")
    return fig


def _errors(comparison: Comparison, experiment: Experiment) -> Drawing:
    """The first follower's error across the leader's way, over time."""
    traces = [found for found in _traces(comparison, experiment) if found[0] in ("smc", "cfc_paper", "cfc")]
    if not traces:
        return Missing(NO_TRACE)
    fig, ((ax,),) = style.Sheet(2.8).axes()
    for name, colour, trace in traces:
        error_mm = 1e3 * (trace.error_m[:, 0, 1] - np.mean(trace.error_m[:, 0, 1]))
        style.line(ax, trace.t_s, error_mm, color=colour, lw=0.9, label=TITLES[name])
    ax.set_ylabel("error in y, mm")
    style.time_axis(ax, 0.0, float(traces[0][2].t_s[-1]))
    style.legend(ax)
    return fig

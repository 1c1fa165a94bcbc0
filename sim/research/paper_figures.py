"""Counterparts of the paper's Figures 5, 6 and 7: the same experiment under one controller after another."""

from collections.abc import Mapping
from typing import Protocol

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter

from analysis.metrics import rms
from analysis.plots import style
from analysis.plots.style import Drawing, Missing
from analysis.words import mm
from formation.maths.arrays import Float

SHIPPED, PRINTED = "cfc", "cfc_paper"
NAMES = {
    "smc": "SMC, printed gains",
    "istsmc": "ISTSMC, printed gains",
    "cfc_paper": "CFC, printed gains",
    "cfc": "CFC, as shipped",
    "cfc_imu": "as shipped, with HIGHRES_IMU",
    "pid": "cascade PID",
    "geometric": "geometric SE(3)",
}
COLOURS = {
    "smc": "#c94f5d",
    "istsmc": "#e8932e",
    "cfc_paper": "#8a6d1f",
    "cfc": "#1f77d0",
    "cfc_imu": "#0b4a8f",
    "pid": "#7a56c8",
    "geometric": "#2a9d6f",
}
COLUMNS = 3


class Trace(Protocol):
    """One flight of one controller, from the start of its formation phase; k followers of n vehicles, leader first."""

    @property
    def t_s(self) -> Float:
        """Times (T,)."""

    @property
    def path_m(self) -> Float:
        """Where the vehicles were, seen from above, lab axes (T, n, 2)."""

    @property
    def error_m(self) -> Float:
        """Off the slot, in the axes of a leader that does not turn (T, k, 2)."""

    @property
    def gust_m_s2(self) -> Float:
        """True push along x on the first follower (T,)."""

    @property
    def z3_m_s2(self) -> Float:
        """The observer's estimate of it (T,)."""


Traces = Mapping[str, Trace]


def gust(traces: Traces) -> Drawing:
    """Figure 5: deviation of the hovering follower under every controller, and Z3 against the true push."""
    blown = {name: trace for name, trace in traces.items() if np.any(trace.gust_m_s2)}
    if not blown:
        return Missing("no flight was blown at")
    fig, column = style.Sheet(7.2, (0.5, 1.5, 1.0, 1.2)).axes()
    names, *axes = [row[0] for row in column]
    for name, trace in blown.items():
        width = 1.8 if name == SHIPPED else 1.1
        for axis, ax in enumerate(axes[:2]):
            deviation = trace.error_m[:, 0, axis]
            style.line(ax, _since_gust(trace), deviation, color=COLOURS[name], lw=width, label=NAMES[name])
    _observers(axes[2], blown)
    for ax, label in zip(axes, ("along x, m", "along y, m", "push along x, m/s²"), strict=True):
        ax.set_ylabel(label)
        ax.axhline(0.0, color=style.FAINT, lw=0.8, zorder=1)
        style.time_axis(ax, -1.0, 9.0, label=False)
        _fit_height(ax)
    axes[2].tick_params(labelbottom=True)
    axes[2].set_xlabel("after the first gust, s")
    names.axis("off")
    names.legend(*axes[0].get_legend_handles_labels(), loc="center left", ncols=COLUMNS, borderaxespad=0.0)
    axes[2].legend(loc="lower right", ncols=3)
    return fig


def _since_gust(trace: Trace) -> Float:
    """Times counted from when the push first passed half its peak."""
    strong = np.abs(trace.gust_m_s2) > 0.5 * np.abs(trace.gust_m_s2).max()
    since: Float = trace.t_s - trace.t_s[int(np.argmax(strong))]
    return since


def _observers(ax: Axes, traces: Traces) -> None:
    """Z3 as printed and as shipped, under the push on the steadiest flight."""
    for name, width in ((PRINTED, 0.5), (SHIPPED, 1.4)):
        if name in traces:
            trace = traces[name]
            style.line(ax, _since_gust(trace), trace.z3_m_s2, color=COLOURS[name], lw=width, label=f"Z3, {NAMES[name]}")
    true = traces.get(SHIPPED, next(iter(traces.values())))
    style.line(ax, _since_gust(true), true.gust_m_s2, color=style.INK, lw=1.0, ls=(0, (4, 2)), label="true push")


def _fit_height(ax: Axes) -> None:
    """Let what lies inside the shown times choose the scale."""
    low, high = ax.get_xlim()
    shown = [
        y[(x >= low) & (x <= high)]
        for x, y in (np.asarray(line.get_xydata(), dtype=np.float64).T for line in ax.lines)
        if len(x) > 2
    ]
    values = np.concatenate(shown) if shown else np.zeros(1)
    margin = 0.08 * max(float(np.ptp(values)), 1e-6)
    ax.set_ylim(float(values.min()) - margin, float(values.max()) + margin)


def formation(traces: Traces) -> Drawing:
    """Figures 6 and 7: the flown formation from above, one panel a controller, one scale for all."""
    flown = {name: trace for name, trace in traces.items() if len(trace.t_s)}
    if not flown:
        return Missing("no flight was traced")
    fig, panels = _panels(len(flown), 2.5, ("lab x, m", "lab y, m"), together=True)
    for ax, (name, trace) in zip(panels, flown.items(), strict=True):
        colours = style.colours(trace.path_m.shape[1])
        wanted = trace.path_m[:, 1:] - trace.error_m
        for k, colour in enumerate(colours[1:]):
            ax.plot(*wanted[::4, k].T, color=style.FAINT, lw=2.6, zorder=1)
            ax.plot(*trace.path_m[::2, k + 1].T, color=colour, lw=0.8, zorder=2)
        ax.plot(*trace.path_m[::2, 0].T, color=colours[0], lw=0.8, zorder=2)
        ax.set_title(NAMES[name])
        ax.set_aspect("equal", adjustable="box")
    for ax in panels:
        ax.apply_aspect()
        style.align_y_label(fig, ax)
    return fig


def deviations(traces: Traces) -> Drawing:
    """Horizontal distance from the slot against time, one panel a controller, one logarithmic scale for all."""
    flown = {name: trace for name, trace in traces.items() if len(trace.t_s)}
    if not flown:
        return Missing("no flight was traced")
    fig, panels = _panels(len(flown), 1.7, ("", "error, mm"), together=False)
    widest_mm = 1.0
    for ax, (name, trace) in zip(panels, flown.items(), strict=True):
        length_mm = 1e3 * np.linalg.norm(trace.error_m, axis=-1)
        for k, colour in enumerate(style.colours(trace.path_m.shape[1])[1:]):
            style.line(ax, trace.t_s, length_mm[:, k], color=colour, lw=0.8)
        widest_mm = max(widest_mm, float(length_mm.max()))
        ax.set_title(f"{NAMES[name]}: {mm(rms(1e-3 * length_mm))} RMS", fontsize=8.5)
        style.time_axis(ax, float(trace.t_s[0]), float(trace.t_s[-1]))
    for ax in panels:
        ax.set(yscale="log", ylim=(0.05, 1.5 * widest_mm))
        ax.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    return fig


def _panels(count: int, height_in: float, labels: tuple[str, str], *, together: bool) -> tuple[Figure, list[Axes]]:
    """A grid of panels, three a row at most, sharing both scales or none; those beyond `count` are not drawn.

    labels: of x, below the lowest of each column, and of y, at the left.
    """
    rows = -(-count // COLUMNS)
    columns = -(-count // rows)
    sheet = style.Sheet(
        rows * (height_in + 0.6), (1.0,) * rows, (1.0,) * columns, gap_in=(0.62, 0.5),
        share_x="all" if together else "none", share_y=together,
    )  # fmt: skip
    fig, grid = sheet.axes()
    panels = [ax for row in grid for ax in row]
    for ax in panels[count:]:
        ax.remove()
    for ax in panels[:count:columns]:
        ax.set_ylabel(labels[1])
    for ax in panels[:count][-columns:]:
        ax.set_xlabel(labels[0])
    return fig, panels[:count]

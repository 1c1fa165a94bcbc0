"""How punctual the loop was: latency, frame spacing, setpoint age."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import NullFormatter, ScalarFormatter

from analysis.load import Flight
from analysis.metrics import ages_ms
from analysis.plots import style
from analysis.plots.style import Drawing, Missing
from formation.maths.arrays import Float

BINS = 60


def histograms(flight: Flight) -> Drawing:
    """Histograms of control latency, mocap frame spacing and setpoint age, those that the log holds."""
    panels = [
        (
            "Control latency",
            "frame received → last datagram sent, ms",
            1e3 * flight.timing.column(lambda t: t.latency_s),
        ),
        ("Frame spacing", "between mocap exposures, ms", 1e3 * np.diff(flight.poses.t_s)),
        ("Setpoint age", "camera → drone, ms", ages_ms(flight)),
    ]
    held = [panel for panel in panels if len(panel[2]) > 1]
    if not held:
        return Missing("no timing was recorded")
    fig, [row] = style.Sheet(2.5, widths=(1.0,) * len(held), share_x="none").axes()
    for ax, (title, label, values_ms) in zip(row, held, strict=True):
        _histogram(ax, values_ms)
        ax.set(title=title, xlabel=label)
    return fig


def _histogram(ax: Axes, values_ms: Float) -> None:
    """Counts on a log scale, so that the rare late ones are seen; median and 99th percentile marked."""
    p50, p99 = np.percentile(values_ms, [50.0, 99.0])
    ax.hist(values_ms, bins=BINS, color="#9db4cc", log=True, zorder=2)
    for value, name, dash in ((p50, "median", "-"), (p99, "99 %", (0, (4, 3)))):
        ax.axvline(value, color=style.INK, lw=0.9, ls=dash, label=f"{name} {value:.3g} ms", zorder=3)
    ax.plot([], [], " ", label=f"max {values_ms.max():.3g} ms")
    ax.set_ylabel("count")
    ax.yaxis.set_major_formatter(ScalarFormatter())
    ax.grid(visible=False, axis="x")
    ax.legend(loc="upper right")


def cycles(flight: Flight) -> Drawing:
    """Latency of every cycle against time, late ones ringed."""
    if not len(flight.timing):
        return Missing("no control cycle was timed")
    fig, [[ax]] = style.Sheet(2.1).axes()
    ms = 1e3 * flight.timing.column(lambda t: t.latency_s)
    late = flight.timing.column(lambda t: t.late) > 0.5
    style.line(ax, flight.timing.t_s, ms, color="#7d98b5", lw=0.8)
    ax.plot(flight.timing.t_s[late], ms[late], "o", ms=5, mfc="none", mec=style.ALARM, label=f"late: {int(late.sum())}")
    ax.set(title="Latency of every cycle", ylabel="ms", yscale="log")
    ax.yaxis.set_major_formatter(ScalarFormatter())
    ax.yaxis.set_minor_formatter(NullFormatter())
    style.time_axis(ax, 0.0, flight.duration_s)
    style.legend(ax)
    return fig

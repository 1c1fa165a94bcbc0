"""What all pictures share: colours, type, axes, thinning of long lines, SVG and PNG; phases and moments on time axes.

Figures are made through matplotlib's object interface; the style is set in a context around drawing and rendering,
so that nothing global changes.
"""

import io
import re
from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any, Literal

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.colors import hsv_to_rgb, to_hex
from matplotlib.figure import Figure

from analysis.load import Flight
from formation.maths.arrays import Bool, Float
from formation.messages import Phase, Severity, Verb
from wire.logs import ALARM as ALARM
from wire.logs import COLOURS

INK = "#1d2733"
SOFT = "#66727f"
FAINT = "#c9d0d8"
LEADER, *FOLLOWERS = COLOURS
PHASES: Mapping[Phase, str] = MappingProxyType(
    {
        Phase.GROUND: "#eef0f2",
        Phase.ARMED: "#f3e7c9",
        Phase.TAKEOFF: "#d9e6f6",
        Phase.FORMATION: "#d8efe2",
        Phase.HOLD: "#e7e3f4",
        Phase.LAND: "#f7e1d3",
        Phase.STOPPED: "#f3c9c6",
    }
)
WIDTH_IN = 10.8
MARGINS_IN = (0.74, 0.06, 0.3, 0.44)  # left, right, top, bottom
FEW = 6  # lines an axes holds at full detail
POINTS = 1100  # points kept of a line: about one a pixel of the page
_STYLE = Path(__file__).with_name("house.mplstyle")


@dataclass(frozen=True, slots=True)
class Missing:
    """Why a picture cannot be drawn, in words."""

    reason: str


Drawing = Figure | Missing


def styled() -> AbstractContextManager[None]:
    """The house style, for the time of drawing or rendering."""
    return mpl.rc_context(fname=_STYLE)


@dataclass(frozen=True, slots=True)
class Sheet:
    """A grid of axes on margins fixed in inches, so that the figures of a page share their left edge.

    heights, widths: relative sizes of the rows and columns; gap_in: between rows, between columns.
    """

    height_in: float
    heights: tuple[float, ...] = (1.0,)
    widths: tuple[float, ...] = (1.0,)
    width_in: float = WIDTH_IN
    gap_in: tuple[float, float] = (0.14, 0.8)
    share_x: Literal["all", "none", "col"] = "all"
    share_y: bool = False

    def axes(self) -> tuple[Figure, list[list[Axes]]]:
        """The figure and its axes, row by row."""
        fig = Figure(figsize=(self.width_in, self.height_in))
        left, right, top, bottom = MARGINS_IN
        rows, columns = len(self.heights), len(self.widths)
        tall = (self.height_in - top - bottom - (rows - 1) * self.gap_in[0]) / rows
        wide = (self.width_in - left - right - (columns - 1) * self.gap_in[1]) / columns
        margins = {
            "left": left / self.width_in,
            "right": 1.0 - right / self.width_in,
            "top": 1.0 - top / self.height_in,
            "bottom": bottom / self.height_in,
            "hspace": self.gap_in[0] / tall,
            "wspace": self.gap_in[1] / wide,
            "height_ratios": self.heights,
            "width_ratios": self.widths,
        }
        grid = fig.subplots(rows, columns, squeeze=False, sharex=self.share_x, sharey=self.share_y, gridspec_kw=margins)
        for ax in grid.ravel():
            align_y_label(fig, ax)
        return fig, [list(row) for row in grid]


def align_y_label(fig: Figure, ax: Axes) -> None:
    """Put the name of y as far left of the axes as the margin is wide."""
    label_in = MARGINS_IN[0] - 0.17
    ax.yaxis.set_label_coords(-label_in / (ax.get_position().width * fig.get_figwidth()), 0.5)


def svg(fig: Figure) -> str:
    """The figure as an SVG element to embed: text as text in the page's own font, no XML prologue, no date."""
    buffer = io.StringIO()
    with styled():
        FigureCanvasSVG(fig)
        fig.savefig(buffer, format="svg", metadata={"Date": None, "Creator": None})
    text = buffer.getvalue()
    text = text[text.index("<svg") :]
    text = re.sub(r"<metadata>.*?</metadata>", "", text, flags=re.S)
    text = re.sub(r"(font: [^'\";]*?px|font-family:) ?'DejaVu Sans'[^;\"]*", r"\1 var(--type)", text)
    text = re.sub(r'(<svg[^>]*?) width="[\d.]+pt" height="[\d.]+pt"', r"\1", text)
    text = re.sub(r' d="[^"]*"', _rounded, text)
    return re.sub(r"\n\s+", "\n", text)


def described(fig: Figure) -> str:
    """What the figure shows in words, for who cannot see it: each axes' quantities, range and lines."""
    return "; ".join(filter(None, (_described(ax) for ax in fig.axes)))


def _described(ax: Axes) -> str:
    low, high = ax.get_xlim()
    x_label = next((a.get_xlabel() for a in [ax, *ax.get_shared_x_axes().get_siblings(ax)] if a.get_xlabel()), "")
    what = ", ".join(filter(None, (ax.get_title(), ax.get_title("left"), ax.get_ylabel())))
    if not what and not x_label:
        return ""
    against = f" against {x_label} from {low:.3g} to {high:.3g}" if x_label else ""
    named = [name for name in ax.get_legend_handles_labels()[1] if name.strip()]
    lines = f" ({', '.join(named)})" if named else ""
    return f"{what or 'the flight'}{against}{lines}"


def _rounded(path: re.Match[str]) -> str:
    """A path's coordinates to a hundredth of a point: less than a pixel shows."""
    return re.sub(r"-?\d+\.\d{3,}", lambda number: f"{float(number.group()):.2f}".rstrip("0").rstrip("."), path.group())


def png(fig: Figure, dpi: int = 150) -> bytes:
    """The figure as a PNG on white."""
    buffer = io.BytesIO()
    with styled():
        FigureCanvasAgg(fig)
        fig.savefig(buffer, format="png", dpi=dpi, facecolor="white")
    return buffer.getvalue()


def colours(vehicles: int) -> tuple[str, ...]:
    """One colour a vehicle, leader first: ink for the leader, hues for the rest."""
    followers = vehicles - 1
    if followers <= len(FOLLOWERS):
        return (LEADER, *FOLLOWERS[: max(followers, 0)])
    hues = (0.58 + np.arange(followers) / followers) % 1.0
    hsv = np.stack([hues, np.full(followers, 0.72), 0.78 - 0.14 * (np.arange(followers) % 2)], axis=-1)
    return (LEADER, *map(to_hex, hsv_to_rgb(hsv)))


def thin(t_s: Float, y: Float, points: int = POINTS) -> tuple[Float, Float]:
    """A line of at most about `points` points that looks the same; shapes (T,).

    Each bucket of samples keeps its first, its extremes and its first NaN, so that peaks and breaks survive.
    """
    size = 3 * len(t_s) // points
    if size < 4:
        return t_s, y
    whole = len(t_s) // size * size
    bucket = y[:whole].reshape(-1, size)
    missing = np.isnan(bucket)
    low = np.argmin(np.where(missing, np.inf, bucket), axis=1)
    high = np.argmax(np.where(missing, -np.inf, bucket), axis=1)
    first = np.arange(len(bucket)) * size
    indices = [first, first + low, first + high, first + np.argmax(missing, axis=1), np.arange(whole, len(t_s))]
    chosen = np.unique(np.concatenate(indices))
    return t_s[chosen], y[chosen]


def line(ax: Axes, t_s: Float, y: Float, *, among: int = 1, **options: Any) -> None:
    """Plot a thinned line against time; NaN breaks it. among: lines the axes will hold; many share the points."""
    ax.plot(*thin(t_s, y, POINTS * FEW // max(among, FEW)), **options)


def broken(values: Float, chosen: Bool) -> Float:
    """The values (T,) with NaN where not kept: lines break there."""
    return np.where(chosen, values, np.nan)


def time_axis(ax: Axes, low_s: float, high_s: float, *, label: bool = True) -> None:
    """Limits and label of a time axis."""
    ax.set_xlim(low_s, high_s if high_s > low_s else low_s + 1.0)
    if label:
        ax.set_xlabel("time, s")
    else:
        ax.tick_params(labelbottom=False)


def legend(ax: Axes, columns: int = 6) -> None:
    """One row of names above the axes, at the right; more than eight are left to the table of followers."""
    if len(ax.get_legend_handles_labels()[1]) > 8:
        return
    ax.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=columns, borderaxespad=0.2)


LEVELS = {
    Severity.EMERGENCY: ALARM,
    Severity.CRITICAL: ALARM,
    Severity.ERROR: ALARM,
    Severity.WARNING: "#d08a1d",
    Severity.NOTICE: SOFT,
    Severity.INFO: FAINT,
}


def shade(axes: Sequence[Axes], flight: Flight) -> None:
    """The flight's phases as faint bands behind every axes."""
    for ax in axes:
        for span in flight.phases:
            if span.phase is not Phase.GROUND:
                ax.axvspan(span.start_s, span.end_s, color=PHASES[span.phase], alpha=0.45, lw=0, zorder=0)


def timeline(flight: Flight) -> Drawing:
    """Phases as one ribbon, operator requests and events as marks on rows of their own."""
    if not flight.phases and not len(flight.events):
        return Missing("neither phases nor events were recorded")
    fig, [[ax]] = Sheet(1.9).axes()
    ax.set(ylim=(-2.6, 1.15), yticks=[0.5, -0.6, -1.7], yticklabels=["phase", "operator", "event"])
    ax.grid(visible=False)
    ax.spines[["left", "bottom"]].set_visible(False)
    ribbon(ax, flight)
    _requests(ax, flight)
    _events(ax, flight)
    time_axis(ax, 0.0, flight.duration_s)
    return fig


def ribbon(ax: Axes, flight: Flight, letter_share: float = 0.0062) -> None:
    """Each phase a bar, with its name where it fits; letter_share: a letter's width as a part of the axes."""
    for span in flight.phases:
        width_s = span.end_s - span.start_s
        ax.barh(0.5, width_s, left=span.start_s, height=1.0, color=PHASES[span.phase], ec="white", lw=1.5)
        if width_s > letter_share * len(span.phase.name) * flight.duration_s:
            middle_s = span.start_s + 0.5 * width_s
            ax.text(middle_s, 0.5, span.phase.name.capitalize(), ha="center", va="center", fontsize=8.5)


def _requests(ax: Axes, flight: Flight) -> None:
    """A triangle for each request that changes something, and its words where they fit before the next."""
    asked = [(float(t_s), r) for t_s, r in zip(flight.requests.t_s, flight.requests.messages, strict=True)]
    asked = [(t_s, request) for t_s, request in asked if request.verb is not Verb.STATUS]
    for k, (t_s, request) in enumerate(asked):
        next_s = asked[k + 1][0] if k + 1 < len(asked) else np.inf
        ax.plot(t_s, -0.6, marker=">", color=INK, ms=5.0, mew=0)
        words = f"{request.verb} {request.argument}".strip()
        if next_s - t_s > (0.0062 * len(words) + 0.012) * flight.duration_s:
            placement = {"xytext": (5.0, 0.0), "textcoords": "offset points", "va": "center", "fontsize": 8.0}
            ax.annotate(words, (t_s, -0.6), **placement)  # type: ignore[arg-type]


def _events(ax: Axes, flight: Flight) -> None:
    """A tick for each event, its colour the severity; the loudest carry their number in the table of events."""
    for t_s, event in zip(flight.events.t_s, flight.events.messages, strict=True):
        loud = event.severity <= Severity.WARNING
        colour = LEVELS[event.severity]
        ax.plot([t_s, t_s], [-2.2, -1.2], color=colour, lw=2.2 if loud else 1.2, solid_capstyle="round")

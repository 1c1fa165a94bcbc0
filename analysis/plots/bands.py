"""Phases and moments drawn on time axes: bands behind lines, the timeline of a flight."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes

from analysis.load import Flight
from analysis.plots import style
from analysis.plots.style import Drawing, Missing
from formation.messages import Phase, Severity, Verb

LEVELS = {
    Severity.EMERGENCY: style.ALARM,
    Severity.CRITICAL: style.ALARM,
    Severity.ERROR: style.ALARM,
    Severity.WARNING: "#d08a1d",
    Severity.NOTICE: style.SOFT,
    Severity.INFO: style.FAINT,
}


def shade(axes: Sequence[Axes], flight: Flight) -> None:
    """The flight's phases as faint bands behind every axes."""
    for ax in axes:
        for span in flight.phases:
            if span.phase is not Phase.GROUND:
                ax.axvspan(span.start_s, span.end_s, color=style.PHASES[span.phase], alpha=0.45, lw=0, zorder=0)


def timeline(flight: Flight) -> Drawing:
    """Phases as one ribbon, operator requests and events as marks on rows of their own."""
    if not flight.phases and not len(flight.events):
        return Missing("neither phases nor events were recorded")
    fig, [[ax]] = style.Sheet(1.9).axes()
    ax.set(ylim=(-2.6, 1.15), yticks=[0.5, -0.6, -1.7], yticklabels=["phase", "operator", "event"])
    ax.grid(visible=False)
    ax.spines[["left", "bottom"]].set_visible(False)
    ribbon(ax, flight)
    _requests(ax, flight)
    _events(ax, flight)
    style.time_axis(ax, 0.0, flight.duration_s)
    return fig


def ribbon(ax: Axes, flight: Flight, letter_share: float = 0.0062) -> None:
    """Each phase a bar, with its name where it fits; letter_share: a letter's width as a part of the axes."""
    for span in flight.phases:
        width_s = span.end_s - span.start_s
        ax.barh(0.5, width_s, left=span.start_s, height=1.0, color=style.PHASES[span.phase], ec="white", lw=1.5)
        if width_s > letter_share * len(span.phase.name) * flight.duration_s:
            middle_s = span.start_s + 0.5 * width_s
            ax.text(middle_s, 0.5, span.phase.name.capitalize(), ha="center", va="center", fontsize=8.5)


def _requests(ax: Axes, flight: Flight) -> None:
    """A triangle for each request that changes something, and its words where they fit before the next."""
    asked = [(float(t_s), r) for t_s, r in zip(flight.requests.t_s, flight.requests.messages, strict=True)]
    asked = [(t_s, request) for t_s, request in asked if request.verb is not Verb.STATUS]
    for k, (t_s, request) in enumerate(asked):
        next_s = asked[k + 1][0] if k + 1 < len(asked) else np.inf
        ax.plot(t_s, -0.6, marker=">", color=style.INK, ms=5.0, mew=0)
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

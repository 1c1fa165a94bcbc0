"""What the drones said of themselves: battery, age of setpoints, silence and loss of the link."""

import numpy as np

from analysis.load import Flight
from analysis.plots import style
from analysis.plots.bands import shade
from analysis.plots.style import Drawing, Missing
from analysis.tables.link_history import histories

PANELS = (
    ("battery_v", "battery, V"),
    ("battery", "charge, %"),
    ("setpoint_age_ms", "setpoint age, ms"),
    ("silent_s", "silence, s"),
    ("lost", "packets lost"),
)


def link(flight: Flight) -> Drawing:
    """One panel for each quantity that a drone reported, one line for each drone."""
    history_of = histories(
        (round(t_s * 1e9), datagram) for t_s, datagram in zip(flight.up.t_s, flight.up.messages, strict=True)
    )
    known = [
        (name, label)
        for name, label in PANELS
        if any(np.isfinite(history[name].astype(np.float64)).any() for history in history_of.values())
    ]
    if not known:
        return Missing("no drone was heard on its link")
    fig, column = style.Sheet(0.74 + 1.1 * len(known), (1.0,) * len(known)).axes()
    axes = [row[0] for row in column]
    colours = style.colours(len(flight.vehicles))
    for ax, (name, label) in zip(axes, known, strict=True):
        for colour, vehicle in zip(colours, flight.vehicles, strict=True):
            if vehicle.sysid in history_of:
                history = history_of[vehicle.sysid]
                values = history[name].astype(np.float64) * (100.0 if name == "battery" else 1.0)
                style.line(ax, history["t_ns"] * 1e-9, values, color=colour, lw=1.1, label=vehicle.body)
        ax.set_ylabel(label)
        style.time_axis(ax, 0.0, flight.duration_s, label=ax is axes[-1])
    style.legend(axes[0])
    shade(axes, flight)
    return fig

"""One picture of a flight, for a README or a slide: the paths, the formation error and the phases on one sheet."""

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from analysis.load import Flight, load
from analysis.metrics import summarise
from analysis.plots import motion, style
from analysis.tracking import Tracking, track
from analysis.words import mm


def picture(path_mcap: Path, path_png: Path, dpi: int = 140) -> Path:
    """Draw the flight of a log into a PNG; returns where. Raises as `analysis.load.load`."""
    flight = load(path_mcap)
    with style.styled():
        fig = sheet(flight)
    path_png.write_bytes(style.png(fig, dpi))
    return path_png


def sheet(flight: Flight) -> Figure:
    """Paths at the left; at the right each follower's x and y, the error, the phases."""
    tracking = track(flight)
    fig = Figure(figsize=(style.WIDTH_IN, 5.9), layout="constrained")
    grid = fig.add_gridspec(4, 2, width_ratios=[1.0, 1.15], height_ratios=[1.0, 1.0, 1.25, 0.42])
    plan = fig.add_subplot(grid[:, 0])
    motion.draw_plan(plan, flight)
    plan.set(title=_title(flight), xlabel="lab x, m", ylabel="lab y, m")
    plan.legend(loc="lower right", ncols=1)
    right = [fig.add_subplot(grid[row, 1]) for row in range(4)]
    _coordinates(right[:2], flight)
    _error(right[2], flight, tracking)
    style.ribbon(right[3], flight, letter_share=0.0145)
    right[3].set(ylim=(0.0, 1.0), yticks=[])
    right[3].grid(visible=False)
    right[3].spines[["left", "bottom"]].set_visible(False)
    for ax in right:
        style.time_axis(ax, 0.0, flight.duration_s, label=ax is right[-1])
    style.shade(right[:3], flight)
    return fig


def _title(flight: Flight) -> str:
    """The flight's name and its error."""
    summary = summarise(flight)
    name = (flight.run.scenario or "flight").replace("_", " ").capitalize()
    if summary.formation_rms_m is None:
        return name
    return f"{name}: formation error {mm(summary.formation_rms_m)} RMS"


def _coordinates(axes: list[Axes], flight: Flight) -> None:
    """x and y of every vehicle."""
    poses = flight.poses
    for axis, ax in enumerate(axes):
        for i, colour in enumerate(style.colours(len(flight.vehicles))):
            style.line(ax, poses.t_s, style.broken(poses.pos_lab_m[:, i, axis], poses.seen[:, i]), color=colour)
        ax.set_ylabel(f"lab {'xy'[axis]}, m")


def _error(ax: Axes, flight: Flight, tracking: Tracking) -> None:
    """Length of the formation error."""
    if tracking.formed.any():
        motion.draw_error(ax, flight, tracking, 1e3 * np.linalg.norm(tracking.error_lead_m, axis=-1))
    ax.set_ylabel("error, mm")
    ax.set_ylim(bottom=0.0)

"""Two flights in one picture, the first dark, the second coloured; times from each one's entry into formation."""

from dataclasses import dataclass

import numpy as np

from analysis.load import Flight
from analysis.plots import style
from analysis.plots.style import Drawing, Missing
from analysis.tracking import Tracking, in_formation_phase, track, track_leader
from formation.maths.arrays import Float
from formation.messages import Phase

COLOURS = (style.LEADER, style.FOLLOWERS[1])


@dataclass(frozen=True, slots=True, eq=False)
class Flown:
    """A flight with its name, its tracking, and when it first entered formation."""

    name: str
    flight: Flight
    tracking: Tracking
    formed_s: float
    first: bool


def flown(name: str, flight: Flight, first: bool) -> Flown:
    """The flight, ready to be laid over another, as the first or the second of the two."""
    spans = flight.spans(Phase.FORMATION)
    return Flown(name, flight, track(flight), spans[0].start_s if spans else 0.0, first)


def errors(a: Flown, b: Flown) -> Drawing:
    """Root mean square of the followers' formation errors against time."""
    lines = [
        (one, one.tracking.t_s[formed], 1e3 * _rms(one.tracking.error_lead_m[formed]))
        for one in (a, b)
        if (formed := one.tracking.formed.all(axis=1)).any()
    ]
    return _against_time(lines, "formation error, mm", "neither flew in formation")


def leader_errors(a: Flown, b: Flown) -> Drawing:
    """Length of the leaders' tracking errors against time."""
    lines = [
        (one, leader.t_s, 1e3 * np.linalg.norm(leader.error_lab_m, axis=-1))
        for one in (a, b)
        if len((leader := track_leader(one.flight)).t_s)
    ]
    return _against_time(lines, "leader tracking error, mm", "neither leader had a reference in formation")


def paths(a: Flown, b: Flown) -> Drawing:
    """Every vehicle's way in formation, from above."""
    if not len(a.flight.poses) and not len(b.flight.poses):
        return Missing("no mocap frame was recorded")
    fig, [[ax]] = style.Sheet(5.0, width_in=0.6 * style.WIDTH_IN).axes()
    for one, colour in zip((a, b), COLOURS, strict=True):
        poses = one.flight.poses
        formed = in_formation_phase(one.flight, poses.t_s)
        for i in range(len(one.flight.vehicles)):
            path_m = poses.pos_lab_m[formed & poses.seen[:, i], i, :2]
            path_m = path_m[:: max(1, len(path_m) // style.POINTS)]
            ax.plot(*path_m.T, color=colour, lw=1.0, alpha=0.8, label=one.name if i == 0 else None)
    ax.set(xlabel="lab x, m", ylabel="lab y, m")
    ax.set_aspect("equal", adjustable="datalim")
    style.legend(ax)
    return fig


def _against_time(lines: list[tuple[Flown, Float, Float]], label: str, missing: str) -> Drawing:
    if not lines:
        return Missing(missing)
    fig, [[ax]] = style.Sheet(2.6).axes()
    for one, t_s, values in lines:
        colour = COLOURS[0] if one.first else COLOURS[1]
        root = float(np.sqrt(np.mean(np.square(values))))
        style.line(ax, t_s - one.formed_s, values, color=colour, lw=1.0, label=f"{one.name}, RMS {root:.3g} mm")
    ax.set(ylabel=label, ylim=(0.0, None))
    style.time_axis(ax, 0.0, max(float(t_s[-1]) - one.formed_s for one, t_s, _ in lines))
    ax.set_xlabel("time in formation, s")
    style.legend(ax)
    return fig


def _rms(error_m: Float) -> Float:
    """(T, k, 3) -> (T,): the root mean square length over the followers."""
    squares: Float = np.sqrt(np.mean(np.sum(np.square(error_m), axis=-1), axis=-1))
    return squares

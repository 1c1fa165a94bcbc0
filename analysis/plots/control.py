"""Inside the controller, on the link, in the loop: sliding variable, disturbance, targets; battery; latency."""

from collections.abc import Callable, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import NullFormatter, ScalarFormatter

from analysis.links import histories
from analysis.load import Flight, Vehicle
from analysis.metrics import ages_ms
from analysis.plots import style
from analysis.plots.motion import worst_followers
from analysis.plots.style import Drawing, Missing, shade
from analysis.tracking import Tracking, airborne, in_formation_phase
from formation.maths import frames
from formation.maths.arrays import Bool, Float
from formation.messages import Saturation

CLOSE_UP_S = 3.0
AXES = ("x", "y", "z")
Truth = Callable[[Vehicle], tuple[Float, Float] | None]


def sliding(flight: Flight) -> Drawing:
    """The sliding variable s of every commanded vehicle, components in its lead frame."""
    if not len(flight.command):
        return Missing("no control command was recorded")
    s = flight.command["s_lead_m_s"]
    return _three(flight, flight.command.t_s, s, "s", "m/s", "Sliding variable s")


def disturbance(flight: Flight) -> Drawing:
    """The observer's Z3 of every commanded vehicle; in a simulation the true disturbance dashed beneath."""
    if not len(flight.command):
        return Missing("no control command was recorded")
    z3 = flight.command["dist_lab_m_s2"]

    def truth(vehicle: Vehicle) -> tuple[Float, Float] | None:
        known = flight.truth.get(vehicle.sysid or 0)
        return None if known is None else (known.t_s, known["dist_lab_m_s2"])

    title = "Disturbance estimate Z3" + (" (dashed: true external disturbance)" if flight.truth else "")
    return _three(flight, flight.command.t_s, z3, "Z3", "m/s²", title, truth)


def output(flight: Flight) -> Drawing:
    """Demanded acceleration, thrust, and which limits were met when."""
    if not len(flight.command):
        return Missing("no control command was recorded")
    acc = flight.command["acc_lab_m_s2"]
    fig, column = style.Sheet(6.4, (1.0, 1.0, 1.0, 1.0, 0.55)).axes()
    axes = [row[0] for row in column]
    _components(axes[:3], flight, flight.command.t_s, acc, "a", "m/s²")
    style.legend(axes[0])
    _thrust(axes[3], flight)
    _limits(axes[4], flight)
    for ax in axes:
        style.time_axis(ax, 0.0, flight.duration_s, label=ax is axes[-1])
    shade(axes, flight)
    return fig


def _three(
    flight: Flight, t_s: Float, values: Float, symbol: str, unit: str, title: str, truth: Truth | None = None
) -> Drawing:
    """Three stacked components (T, m, 3) of every commanded vehicle."""
    fig, column = style.Sheet(4.4, (1.0, 1.0, 1.0)).axes()
    axes = [row[0] for row in column]
    _components(axes, flight, t_s, values, symbol, unit, truth)
    axes[0].set_title(title)
    style.legend(axes[0])
    for ax in axes:
        style.time_axis(ax, 0.0, flight.duration_s, label=ax is axes[-1])
    shade(axes, flight)
    return fig


def _components(
    axes: Sequence[Axes],
    flight: Flight,
    t_s: Float,
    values: Float,
    symbol: str,
    unit: str,
    truth: Truth | None = None,
) -> None:
    """One component an axes, one line a vehicle; the scale is that of the formation phase."""
    n = len(flight.vehicles)
    shown = _scale_times(flight, t_s)
    for axis, ax in enumerate(axes):
        samples = [values[shown][..., axis].ravel()]
        for vehicle, colour in zip(flight.vehicles, style.colours(n), strict=True):
            if vehicle.column is None:
                continue
            style.line(ax, t_s, values[:, vehicle.column, axis], among=n, color=colour, lw=1.0, label=vehicle.body)
            known = None if truth is None else truth(vehicle)
            if known is not None:
                style.line(ax, known[0], known[1][:, axis], among=n, color=style.INK, lw=0.8, ls=(0, (3, 2)), alpha=0.7)
                samples.append(known[1][_scale_times(flight, known[0]), axis])
        ax.axhline(0.0, color=style.FAINT, lw=0.8, zorder=1)
        ax.set_ylabel(f"{symbol} {AXES[axis]}, {unit}")
        ax.set_ylim(*_central(np.concatenate(samples)))


def _scale_times(flight: Flight, t_s: Float) -> Bool:
    """The times that choose a scale: formation, else the air, else all; on the ground the observers hold gravity."""
    for times in (in_formation_phase(flight, t_s), airborne(flight, t_s)):
        if times.any():
            return times
    return np.ones(len(t_s), dtype=np.bool_)


def _central(values: Float) -> tuple[float, float]:
    """A range that shows the central 99.8 % of the values, with a margin."""
    low, high = np.percentile(values, [0.1, 99.9]) if values.size else (0.0, 0.0)
    margin = 0.15 * max(float(high - low), 1e-3)
    return float(low) - margin, float(high) + margin


def _thrust(ax: Axes, flight: Flight) -> None:
    """Commanded thrust of every commanded vehicle."""
    thrust = flight.target["thrust_norm"]
    n = len(flight.vehicles)
    for vehicle, colour in zip(flight.vehicles, style.colours(n), strict=True):
        if vehicle.column is not None and len(flight.target):
            style.line(ax, flight.target.t_s, thrust[:, vehicle.column], among=n, color=colour, lw=1.0)
    ax.set_ylabel("thrust, 0..1")


def _limits(ax: Axes, flight: Flight) -> None:
    """A row a vehicle, marked where any limit cut its target; the limits met are named at the right."""
    commanded = [v for v in flight.vehicles if v.column is not None]
    if not len(flight.target):
        return
    bits = flight.target["saturation"].astype(np.int64)
    flying = in_formation_phase(flight, flight.target.t_s)
    colours = dict(zip(flight.vehicles, style.colours(len(flight.vehicles)), strict=True))
    for row, vehicle in enumerate(commanded):
        hit = bits[:, vehicle.column or 0] != 0
        ax.eventplot(
            _first_of_each(flight.target.t_s[hit]), lineoffsets=-row, linelengths=0.8, lw=0.8, color=colours[vehicle]
        )
    met = Saturation(int(np.bitwise_or.reduce(bits[flying].ravel()))) if flying.any() else Saturation.NONE
    names = ", ".join(name.lower().replace("_", " ") for name in _names(met)) or "none"
    ax.set(ylim=(-len(commanded) + 0.4, 0.6), yticks=[], ylabel="limits")
    ax.grid(visible=False, axis="y")
    ax.text(1.0, 1.02, f"met in formation: {names}", transform=ax.transAxes, ha="right", fontsize=7.5, color=style.SOFT)


def _names(met: Saturation) -> list[str]:
    """The limits' names, one by one."""
    return [limit.name for limit in Saturation if limit in met and limit.name]


def _first_of_each(t_s: Float, bin_s: float = 0.05) -> Float:
    """At most one time a bin: marks closer than that overlap."""
    if not len(t_s):
        return t_s
    return t_s[np.unique((t_s / bin_s).astype(np.int64), return_index=True)[1]]


def attitude(flight: Flight, tracking: Tracking) -> Drawing:
    """Roll and pitch of each follower, or of a leader that flew alone, against their targets, and a close-up of the
    liveliest seconds."""
    if not len(flight.target) or not len(flight.poses):
        return Missing("attitude against target needs mocap frames and attitude targets; the log lacks one of them")
    chosen = tuple(k + 1 for k in worst_followers(tracking, 4)) or (0,)
    rows = (1.0,) * len(chosen)
    fig, grid = style.Sheet(0.6 + 1.6 * len(chosen), rows, (1.2, 1.2, 1.0), gap_in=(0.34, 0.8), share_x="col").axes()
    wanted = np.degrees(roll_pitch(flight.target["q_lab_from_flu"]))
    measured = np.degrees(roll_pitch(flight.poses.q_lab_from_flu))
    start_s = _liveliest(flight, wanted)
    colours = style.colours(len(flight.vehicles))
    for row, k in zip(grid, chosen, strict=True):
        column = flight.vehicles[k].column or 0
        for ax, axis in zip(row, (0, 1, 1), strict=True):
            tilt = style.broken(measured[:, k, axis], flight.poses.seen[:, k])
            style.line(ax, flight.target.t_s, wanted[:, column, axis], color="#9aa5b1", lw=1.3, label="target")
            style.line(ax, flight.poses.t_s, tilt, color=colours[k], lw=0.9, label=flight.vehicles[k].body)
        row[0].set_title(flight.vehicles[k].body)
        row[0].set_ylabel("roll, °")
        row[1].set_ylabel("pitch, °")
        _close_up(row[2], flight, wanted[:, column, 1], measured[:, k, 1], start_s)
        for ax in row[:2]:
            style.time_axis(ax, 0.0, flight.duration_s, label=row is grid[-1])
        style.time_axis(row[2], start_s, start_s + CLOSE_UP_S, label=row is grid[-1])
        style.legend(row[2])
    shade([ax for row in grid for ax in row[:2]], flight)
    return fig


def _close_up(ax: Axes, flight: Flight, wanted: Float, measured: Float, start_s: float) -> None:
    """The scale of the seconds shown."""
    inside = _within(flight.target.t_s, start_s), _within(flight.poses.t_s, start_s)
    shown = np.concatenate([wanted[inside[0]], measured[inside[1]]])
    ax.set_ylim(*_central(shown))
    ax.set_ylabel("pitch, °")


def _within(t_s: Float, start_s: float) -> Bool:
    """Mask of the close-up's seconds."""
    return (t_s >= start_s) & (t_s <= start_s + CLOSE_UP_S)


def _liveliest(flight: Flight, wanted_deg: Float) -> float:
    """Start of the seconds in formation in which the pitch targets vary most."""
    t_s = flight.target.t_s
    formed = in_formation_phase(flight, t_s)
    starts = np.arange(t_s[0], max(t_s[-1] - CLOSE_UP_S, t_s[0] + 1e-6), CLOSE_UP_S / 2.0)
    low, high = np.searchsorted(t_s, starts), np.searchsorted(t_s, starts + CLOSE_UP_S, "right")
    windows = [wanted_deg[a:b][formed[a:b]][..., 1] for a, b in zip(low, high, strict=True)]
    return float(starts[int(np.argmax([float(np.var(w)) if w.size else -1.0 for w in windows]))])


def roll_pitch(q_lab_from_flu: Float) -> Float:
    """Roll and pitch (rad) about the heading's own axes, shape (..., 2): small-angle tilt left-down and nose-down.

    Roll is positive right side down, pitch positive nose down (right-handed about forward and left).
    """
    level = frames.multiply(frames.inverse(frames.from_yaw(frames.yaw(q_lab_from_flu))), q_lab_from_flu)
    w, x, y, z = np.moveaxis(level, -1, 0)
    roll = np.arctan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))
    pitch = np.arcsin(np.clip(2.0 * (w * y - z * x), -1.0, 1.0))
    return np.stack([roll, pitch], axis=-1)


PANELS = (
    ("battery_v", "battery, V"),
    ("battery", "charge, %"),
    ("setpoint_age_ms", "setpoint age, ms"),
    ("silent_s", "silence, s"),
    ("lost", "packets lost"),
)


def link(flight: Flight) -> Drawing:
    """One panel for each quantity that a drone reported, one line for each drone."""
    history_of = histories(flight.up)
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


def histograms(flight: Flight) -> Drawing:
    """Histograms of control latency, mocap frame spacing and setpoint age, those that the log holds."""
    panels = [
        (
            "Control latency",
            "frame received → last datagram sent, ms",
            1e3 * flight.timing["latency_s"],
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
    ax.hist(values_ms, bins=60, color="#9db4cc", log=True, zorder=2)
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
    ms = 1e3 * flight.timing["latency_s"]
    late = flight.timing["late"]
    style.line(ax, flight.timing.t_s, ms, color="#7d98b5", lw=0.8)
    ax.plot(flight.timing.t_s[late], ms[late], "o", ms=5, mfc="none", mec=style.ALARM, label=f"late: {int(late.sum())}")
    ax.set(title="Latency of every cycle", ylabel="ms", yscale="log")
    ax.yaxis.set_major_formatter(ScalarFormatter())
    ax.yaxis.set_minor_formatter(NullFormatter())
    style.time_axis(ax, 0.0, flight.duration_s)
    style.legend(ax)
    return fig

"""Where the drones flew, from above, from the side and in 3-D; how they held their slots and trajectories."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Rectangle
from mpl_toolkits.mplot3d.axes3d import Axes3D

from analysis.load import Flight
from analysis.plots import style
from analysis.plots.style import Drawing, Missing, shade
from analysis.tracking import LeaderTracking, Tracking, airborne, in_formation_phase, reference_lab_m
from formation.maths.arrays import Bool, Float, Vec3


def where(flight: Flight) -> Drawing:
    """Every vehicle's path from above and in three dimensions, side by side."""
    if not len(flight.poses):
        return Missing("no mocap frame was recorded")
    fig = Figure(figsize=(style.WIDTH_IN, 4.9))
    plan = fig.add_axes((0.0685, 0.1, 0.43, 0.81))
    draw_plan(plan, flight)
    plan.set(title="From above", xlabel="lab x, m", ylabel="lab y, m")
    style.legend(plan, columns=4)
    space = fig.add_axes((0.5, -0.02, 0.47, 1.06), projection="3d")
    draw_space(space, flight)
    return fig


def heights(flight: Flight) -> Drawing:
    """Height of every vehicle against time."""
    poses = flight.poses
    if not len(poses):
        return Missing("no mocap frame was recorded")
    fig, [[ax]] = style.Sheet(1.8).axes()
    for i, colour in enumerate(style.colours(len(flight.vehicles))):
        z = style.broken(poses.pos_lab_m[:, i, 2], poses.seen[:, i])
        style.line(ax, poses.t_s, z, among=len(flight.vehicles), color=colour)
    ax.set(title="Height", ylabel="lab z, m")
    ax.set_ylim(bottom=min(0.0, ax.get_ylim()[0]))
    style.time_axis(ax, 0.0, flight.duration_s)
    shade([ax], flight)
    return fig


def draw_plan(ax: Axes, flight: Flight) -> None:
    """Paths in the horizontal plane on equal axes: faint outside the formation phase, strong inside."""
    poses, names = flight.poses, [v.body for v in flight.vehicles]
    formed = _formed(flight)
    width = 1.6 if formed.sum() < 6000 else 0.9  # of long paths
    for i, colour in enumerate(style.colours(len(names))):
        xy = _path(poses.pos_lab_m[:, i, :2], poses.seen[:, i])
        ax.plot(*_spaced(xy, len(names)).T, color=colour, lw=0.8, alpha=0.35)
        strong = _path(poses.pos_lab_m[:, i, :2], poses.seen[:, i] & formed)
        ax.plot(*_spaced(strong, len(names)).T, color=colour, lw=width, label=names[i])
    _snapshots(ax, flight, formed)
    ax.set_aspect("equal", adjustable="datalim")
    ax.margins(0.08)
    _fence(ax, flight)


def paths_m(flight: Flight) -> Iterator[Float]:
    """Of each vehicle where it was seen in formation, from above, (k, 2): about a point a pixel of the page."""
    poses = flight.poses
    formed = in_formation_phase(flight, poses.t_s)
    for i in range(len(flight.vehicles)):
        path_m = poses.pos_lab_m[formed & poses.seen[:, i], i, :2]
        yield path_m[:: max(1, len(path_m) // style.POINTS)]


def _formed(flight: Flight) -> Bool:
    """The frames drawn strongly: the formation phase, else the whole flight."""
    formed = in_formation_phase(flight, flight.poses.t_s)
    return formed if formed.any() else np.ones(len(formed), dtype=np.bool_)


def _path(points: Float, shown: Bool) -> Float:
    """Points (T, d) with NaN where not kept."""
    return np.where(shown[:, None], points, np.nan)


def _spaced(points: Float, among: int = 1, most: int = 1500) -> Float:
    """Every so many-th point of one of `among` paths: an even thinning that keeps its NaN breaks."""
    step = max(1, len(points) * max(among, style.FEW) // (most * style.FEW))
    return points[::step]


def _snapshots(ax: Axes, flight: Flight, formed: Bool) -> None:
    """Lines from the leader to each follower at even times of the formation, and a dot for each vehicle."""
    frames = np.flatnonzero(formed & flight.poses.seen.all(axis=1))
    if not len(frames):
        return
    colours = style.colours(len(flight.vehicles))
    for k in frames[np.linspace(0, len(frames) - 1, 7).astype(int)]:
        xy = flight.poses.pos_lab_m[k, :, :2]
        for follower in xy[1:]:
            ax.plot(*np.stack([xy[0], follower]).T, color=style.SOFT, lw=0.6, alpha=0.45, zorder=1)
        ax.scatter(xy[:, 0], xy[:, 1], s=14, c=list(colours), edgecolors="white", linewidths=0.6, zorder=4)


def _fence(ax: Axes, flight: Flight) -> None:
    """The fence's outline."""
    if flight.run.lab is None:
        return
    fence = flight.run.lab.limits.fence
    corner, size = fence.low_m[:2], np.subtract(fence.high_m, fence.low_m)[:2]
    ax.add_patch(Rectangle(corner, size[0], size[1], fill=False, ec=style.ALARM, lw=0.9, ls=(0, (6, 4)), alpha=0.6))


def draw_space(ax: Axes3D, flight: Flight) -> None:
    """Paths while airborne, equal scales, light panes."""
    poses = flight.poses
    flying = airborne(flight, poses.t_s)
    flying = flying if flying.any() else np.ones(len(poses), dtype=np.bool_)
    low, high = _box(poses.pos_lab_m[flying & poses.seen.all(axis=1)])
    for i, colour in enumerate(style.colours(len(flight.vehicles))):
        path = _spaced(_path(poses.pos_lab_m[:, i], poses.seen[:, i] & flying), len(flight.vehicles))
        ax.plot(path[:, 0], path[:, 1], np.full(len(path), low[2]), color=colour, lw=0.7, alpha=0.18)
        ax.plot(*path.T, color=colour, lw=1.3, label=flight.vehicles[i].body)
    ax.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
    ax.set_box_aspect(high - low, zoom=1.0)
    ax.set(xlabel="x, m", ylabel="y, m", zlabel="z, m")
    ax.view_init(elev=24.0, azim=-58.0)
    for axis in (ax.xaxis, ax.yaxis, ax.zaxis):
        axis.set_pane_color((1.0, 1.0, 1.0, 0.0))


def _box(points: Float) -> tuple[Vec3, Vec3]:
    """The drawn volume (m): the points' own, from the floor up, no side thinner than a third of the widest."""
    flat = points.reshape(-1, 3) if points.size else np.zeros((1, 3))
    low, high = flat.min(axis=0), flat.max(axis=0)
    low[2] = min(low[2], 0.0)
    least = max(float((high - low).max()) / 3.0, 0.2)
    short = np.maximum(least - (high - low), 0.0)
    return low - short * np.array([0.5, 0.5, 0.0]), high + short * np.array([0.5, 0.5, 1.0])


NO_LEADER = "the leader's tracking error needs its mocap frames and references in formation; the log lacks them"
NO_TRACKING = "formation error needs mocap frames and control references; the log lacks one of them"


def worst_followers(tracking: Tracking, most: int = 6) -> tuple[int, ...]:
    """The followers drawn one by one: all, or those with the largest RMS error; in the configuration's order."""
    count = tracking.formed.shape[1]
    if count <= most:
        return tuple(range(count))
    squares = np.where(tracking.formed, np.sum(np.square(tracking.error_lead_m), axis=-1), 0.0).sum(axis=0)
    return tuple(sorted(np.argsort(-squares)[:most].tolist()))


def positions(flight: Flight, tracking: Tracking) -> Drawing:
    """x, y and z of each follower against its reference, lab axes: one row a follower."""
    if not len(tracking.t_s):
        return Missing(NO_TRACKING)
    chosen = worst_followers(tracking)
    rows = (1.0,) * len(chosen)
    fig, grid = style.Sheet(0.6 + 1.55 * len(chosen), rows, (1.0, 1.0, 1.0), gap_in=(0.34, 0.7)).axes()
    wanted = reference_lab_m(flight.reference)
    for row, k in zip(grid, chosen, strict=True):
        column = flight.followers[k].column
        reference = None if column is None else wanted[:, column]
        _against_reference(row, flight, k + 1, reference, label=row is grid[-1])
    return fig


def errors(flight: Flight, tracking: Tracking) -> Drawing:
    """Length of each follower's formation error against time, its components below; unscored frames drawn thin."""
    if not tracking.formed.any():
        return Missing("no frame was flown in formation" if len(tracking.t_s) else NO_TRACKING)
    length_mm = 1e3 * np.linalg.norm(tracking.error_lead_m, axis=-1)
    if tracking.formed.shape[1] > 2:  # whose errors a reader can distinguish in one picture
        return _errors_by_follower(flight, tracking, length_mm)
    fig, column = style.Sheet(5.4, (1.7, 1.0, 1.0, 1.0)).axes()
    axes = [row[0] for row in column]
    draw_error(axes[0], flight, tracking, length_mm)
    axes[0].set(ylabel="length, mm", ylim=(0.0, None))
    style.legend(axes[0])
    for axis, (ax, name) in enumerate(zip(axes[1:], ("forward", "left", "up"), strict=True)):
        draw_error(ax, flight, tracking, 1e3 * tracking.error_lead_m[..., axis])
        ax.axhline(0.0, color=style.FAINT, lw=0.8, zorder=1)
        ax.set_ylabel(f"{name}, mm")
    low_s, high_s = _formed_span(tracking)
    for ax in axes:
        style.time_axis(ax, low_s, high_s, label=ax is axes[-1])
    return fig


def _errors_by_follower(flight: Flight, tracking: Tracking, length_mm: Float) -> Drawing:
    """The lengths alone, a follower a row, on one scale: of many lines the last hides the others."""
    chosen = worst_followers(tracking)
    fig, column = style.Sheet(0.6 + 0.95 * len(chosen), (1.0,) * len(chosen), share_y=True).axes()
    low_s, high_s = _formed_span(tracking)
    high_mm = 1.1 * float(length_mm[tracking.scored].max(initial=0.1))
    for k, (ax,) in zip(chosen, column, strict=True):
        one = replace(tracking, formed=_only(tracking.formed, k), scored=_only(tracking.scored, k))
        draw_error(ax, flight, one, length_mm)
        ax.set(ylabel=f"{flight.followers[k].body}, mm", ylim=(0.0, high_mm))
        style.time_axis(ax, low_s, high_s, label=k == chosen[-1])
    return fig


def _only(flags: Bool, k: int) -> Bool:
    """The flags (T, n) of column k, no others."""
    only: Bool = flags & (np.arange(flags.shape[1]) == k)
    return only


def leader_error(flight: Flight, leader: LeaderTracking) -> Drawing:
    """Length of a commanded leader's tracking error against time, its components in lab axes below."""
    if not len(leader.t_s):
        observed = bool(flight.vehicles) and flight.leader.column is None
        return Missing("the leader is only observed, so it has no reference" if observed else NO_LEADER)
    fig, column = style.Sheet(5.4, (1.7, 1.0, 1.0, 1.0)).axes()
    axes = [row[0] for row in column]
    error_mm = 1e3 * leader.error_lab_m
    length_mm = np.linalg.norm(error_mm, axis=-1)
    style.line(axes[0], leader.t_s, length_mm, color=style.LEADER, lw=1.1, label=flight.leader.body)
    root_mm = float(np.sqrt(np.mean(np.square(length_mm))))
    axes[0].axhline(root_mm, color=style.SOFT, lw=0.9, ls=(0, (4, 3)), label=f"RMS {root_mm:.3g} mm")
    axes[0].set(ylabel="length, mm", ylim=(0.0, None))
    style.legend(axes[0])
    for axis, (ax, name) in enumerate(zip(axes[1:], "xyz", strict=True)):
        style.line(ax, leader.t_s, error_mm[:, axis], color=style.LEADER, lw=1.0)
        ax.axhline(0.0, color=style.FAINT, lw=0.8, zorder=1)
        ax.set_ylabel(f"{name}, mm")
    for ax in axes:
        style.time_axis(ax, float(leader.t_s[0]), float(leader.t_s[-1]), label=ax is axes[-1])
    return fig


def leader_positions(flight: Flight) -> Drawing:
    """x, y and z of a commanded leader against its reference, lab axes, over the whole flight."""
    column = flight.leader.column if flight.vehicles else None
    if column is None or not len(flight.poses) or not len(flight.reference):
        return Missing(NO_LEADER)
    fig, [row] = style.Sheet(2.15, (1.0,), (1.0, 1.0, 1.0)).axes()
    _against_reference(row, flight, 0, reference_lab_m(flight.reference)[:, column], label=True)
    return fig


def _against_reference(row: list[Axes], flight: Flight, i: int, wanted_m: Float | None, *, label: bool) -> None:
    """x, y and z of vehicle i as measured and, dashed over it, its reference (T, 3) of every reference, if any."""
    colour, name = style.colours(len(flight.vehicles))[i], flight.vehicles[i].body
    for axis, ax in enumerate(row):
        measured = style.broken(flight.poses.pos_lab_m[:, i, axis], flight.poses.seen[:, i])
        style.line(ax, flight.poses.t_s, measured, color=colour, lw=1.7, label=name)
        if wanted_m is not None:
            ink, ls = style.ALARM if i == 0 else style.INK, (0, (4, 2))
            style.line(ax, flight.reference.t_s, wanted_m[:, axis], color=ink, lw=0.8, ls=ls, label="reference")
        style.time_axis(ax, 0.0, flight.duration_s, label=label)
        ax.set_ylabel(f"{'xyz'[axis]}, m")
    row[0].set_title(name)
    style.legend(row[2])
    shade(row, flight)


def draw_error(ax: Axes, flight: Flight, tracking: Tracking, error_mm: Float) -> None:
    """One component of every follower's error (T, k): strong where scored, thin while its slot moves."""
    colours = style.colours(len(flight.vehicles))[1:]
    for k, colour in enumerate(colours):
        moving = style.broken(error_mm[:, k], tracking.formed[:, k])
        scored = style.broken(error_mm[:, k], tracking.scored[:, k])
        style.line(ax, tracking.t_s, moving, among=len(colours), color=colour, lw=0.6, alpha=0.5)
        style.line(ax, tracking.t_s, scored, among=len(colours), color=colour, lw=1.1, label=flight.followers[k].body)
    _limit_to_scored(ax, error_mm[tracking.scored])


def _limit_to_scored(ax: Axes, scored_mm: Float) -> None:
    """Let the scored frames choose the scale, so that the entry's large errors do not flatten them."""
    if scored_mm.size:
        low, high = float(scored_mm.min()), float(scored_mm.max())
        margin = 0.12 * max(high - low, 0.1)
        ax.set_ylim(low - margin, high + margin)


def _formed_span(tracking: Tracking) -> tuple[float, float]:
    """First and last time in formation."""
    t_s = tracking.t_s[tracking.formed.any(axis=1)]
    return float(t_s[0]), float(t_s[-1])


def clouds(flight: Flight, tracking: Tracking) -> Drawing:
    """Each follower's horizontal error as a cloud about its slot, rings holding 50 and 95 % of the frames."""
    if not tracking.scored.any():
        return Missing("no scored formation frame: there is no cloud to draw")
    chosen = worst_followers(tracking, 5)
    left, right, top, bottom = style.MARGINS_IN
    side_in = min(2.7, (style.WIDTH_IN - left - right) / len(chosen) - 0.3)
    width_in = left + right + len(chosen) * side_in + (len(chosen) - 1) * 0.3
    sheet = style.Sheet(
        side_in + top + bottom + 0.14, widths=(1.0,) * len(chosen), width_in=width_in, gap_in=(0.0, 0.3), share_y=True
    )
    fig, [row] = sheet.axes()
    colours = style.colours(len(flight.vehicles))
    widest = 1.0
    for ax, k in zip(row, chosen, strict=True):
        xy_mm = 1e3 * tracking.error_lead_m[tracking.scored[:, k], k, :2]
        widest = max(widest, _cloud(ax, xy_mm, colours[k + 1], flight.followers[k].body))
        ax.set_xlabel("left ← error → right, mm")
    row[0].set_ylabel("back ← error → forward, mm")
    for ax in row:
        ax.set(xlim=(widest, -widest), ylim=(-widest, widest), aspect="equal")
    return fig


def _cloud(ax: Axes, xy_mm: Float, colour: str, name: str) -> float:
    """One cloud, seen from above with forward up; returns the half width (mm) that shows 99 % of it."""
    if not len(xy_mm):
        return 1.0
    some = xy_mm[:: max(1, len(xy_mm) // 3000)]
    ax.scatter(some[:, 1], some[:, 0], s=3, color=colour, alpha=0.25, linewidths=0, zorder=2, rasterized=True)
    radius = np.linalg.norm(xy_mm, axis=1)
    half, most = (float(r) for r in np.percentile(radius, [50.0, 95.0]))
    ax.add_patch(Circle((0.0, 0.0), half, fill=False, ec=style.INK, lw=0.9, zorder=3))
    ax.add_patch(Circle((0.0, 0.0), most, fill=False, ec=style.INK, lw=0.9, ls=(0, (4, 3)), zorder=3))
    ax.set_title(f"{name}\n50 % in {half:.2g} mm, 95 % in {most:.2g} mm", fontsize=8.0)
    ax.axhline(0.0, color=style.FAINT, lw=0.8, zorder=1)
    ax.axvline(0.0, color=style.FAINT, lw=0.8, zorder=1)
    return 1.25 * float(np.percentile(radius, 99.0))

"""Where the drones flew: from above, from the side and in three dimensions."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from mpl_toolkits.mplot3d.axes3d import Axes3D

from analysis.load import Flight
from analysis.plots import style
from analysis.plots.bands import shade
from analysis.plots.style import Drawing, Missing
from analysis.tracking import airborne, in_formation_phase
from formation.maths.arrays import Bool, Float, Vec3

SNAPSHOTS = 7
PATH_POINTS = 1500
LONG_FRAMES = 6000  # paths of more frames than this are drawn thinner


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
    width = 1.6 if formed.sum() < LONG_FRAMES else 0.9
    for i, colour in enumerate(style.colours(len(names))):
        xy = _path(poses.pos_lab_m[:, i, :2], poses.seen[:, i])
        ax.plot(*_spaced(xy, len(names)).T, color=colour, lw=0.8, alpha=0.35)
        strong = _path(poses.pos_lab_m[:, i, :2], poses.seen[:, i] & formed)
        ax.plot(*_spaced(strong, len(names)).T, color=colour, lw=width, label=names[i])
    _snapshots(ax, flight, formed)
    ax.set_aspect("equal", adjustable="datalim")
    ax.margins(0.08)
    _fence(ax, flight)


def _formed(flight: Flight) -> Bool:
    """The frames drawn strongly: the formation phase, else the whole flight."""
    formed = in_formation_phase(flight, flight.poses.t_s)
    return formed if formed.any() else np.ones(len(formed), dtype=np.bool_)


def _path(points: Float, shown: Bool) -> Float:
    """Points (T, d) with NaN where not kept."""
    return np.where(shown[:, None], points, np.nan)


def _spaced(points: Float, among: int = 1) -> Float:
    """Every so many-th point of one of `among` paths: an even thinning that keeps its NaN breaks."""
    step = max(1, len(points) * max(among, style.FEW) // (PATH_POINTS * style.FEW))
    return points[::step]


def _snapshots(ax: Axes, flight: Flight, formed: Bool) -> None:
    """Lines from the leader to each follower at even times of the formation, and a dot for each vehicle."""
    frames = np.flatnonzero(formed & flight.poses.seen.all(axis=1))
    if not len(frames):
        return
    colours = style.colours(len(flight.vehicles))
    for k in frames[np.linspace(0, len(frames) - 1, SNAPSHOTS).astype(int)]:
        xy = flight.poses.pos_lab_m[k, :, :2]
        for follower in xy[1:]:
            ax.plot(*np.stack([xy[0], follower]).T, color=style.SOFT, lw=0.6, alpha=0.45, zorder=1)
        ax.scatter(xy[:, 0], xy[:, 1], s=14, c=list(colours), edgecolors="white", linewidths=0.6, zorder=4)


def _fence(ax: Axes, flight: Flight) -> None:
    """The fence's outline, where it comes into view: an artist, not a patch, so that it does not set the scale."""
    if flight.run.lab is None:
        return
    fence = flight.run.lab.limits.fence
    corner, size = fence.low_m[:2], np.subtract(fence.high_m, fence.low_m)[:2]
    ax.add_artist(Rectangle(corner, size[0], size[1], fill=False, ec=style.ALARM, lw=0.9, ls=(0, (6, 4)), alpha=0.6))


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

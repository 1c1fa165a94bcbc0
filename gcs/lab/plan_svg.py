"""A lab from above as one SVG: fence, slots at the start, the leader's path and theirs, as far as they leave it."""

from pathlib import Path

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Rectangle

from formation.maths.arrays import Float
from gcs.lab.drawing import Drawing

FENCE, LEADER, FOLLOWER = "#8a1c1c", "#1f4e9c", "#d9730d"


def write_plan(file: Path, drawing: Drawing, subtitle: str) -> None:
    """Write the lab as SVG: x forward is up, y left is to the left. subtitle: the lines under its name. OSError."""
    (x0, y0), (x1, y1) = drawing.low_m[:2], drawing.high_m[:2]
    fig = Figure(figsize=(7.0, 7.0), layout="constrained")
    axes = fig.add_subplot(aspect="equal", xlabel="y left, m", ylabel="x forward, m")
    axes.set_title("\n".join(filter(None, (drawing.name, subtitle, drawing.beyond))), fontsize="medium")
    axes.add_patch(Rectangle((y0, x0), y1 - y0, x1 - x0, ec=FENCE, fc="none", lw=2.0, label="fence", gid="fence"))
    for path in drawing.swept:
        axes.plot(*_sheet(path), color=FOLLOWER, lw=1.0, alpha=0.5)
    axes.plot(*_sheet(drawing.path), color=LEADER, lw=2.0, label="leader's path")
    for path in (*drawing.swept, drawing.path):
        for run in _outside(path, drawing):
            axes.plot(*_sheet(run), color=FENCE, lw=3.0, gid="outside")
    for body, at in zip(drawing.bodies[1:], drawing.slots, strict=True):
        _body(axes, body, at, FENCE if _outside(at[None], drawing) else FOLLOWER, "o", drawing)
    _body(axes, drawing.bodies[0], drawing.leader, LEADER, (3, 0, float(np.degrees(drawing.heading_rad))), drawing)
    axes.plot([], [], color=FOLLOWER, label="slots' paths")
    axes.plot([], [], ":", color="gray", label="minimum separation")
    (low_x, low_y), (high_x, high_y) = drawing.bounds
    axes.set(xlim=(high_y + 0.1, low_y - 0.1), ylim=(low_x - 0.1, high_x + 0.1))
    fig.legend(loc="outside lower center", ncols=4)
    with rc_context({"svg.fonttype": "none", "svg.hashsalt": "lab"}):
        fig.savefig(file, format="svg", metadata={"Date": None, "Title": f"{drawing.name} from above"})


def _sheet(points: Float) -> tuple[Float, Float]:
    """To the right and up on the sheet, whose horizontal axis is turned round, of points (k, 2)."""
    return points[:, 1], points[:, 0]


def _body(axes: Axes, name: str, at: Float, colour: str, marker: object, drawing: Drawing) -> None:
    """A body at the start, in the circle that no two may share, and named."""
    radius_m, centre = 0.5 * drawing.min_separation_m, (at[1], at[0])
    axes.add_patch(Circle(centre, radius_m, ec=colour, fc="none", ls=":", gid=f"at-{name}"))
    axes.plot(*centre, marker=marker, color=colour, ms=9.0)
    axes.annotate(name, centre, (8.0, 8.0), textcoords="offset points", annotation_clip=True)


def _outside(path: Float, drawing: Drawing) -> list[Float]:
    """The parts of a path (k, 2) that are beyond the fence, seen from above."""
    out = ((path < np.array(drawing.low_m[:2]) - 1e-9) | (path > np.array(drawing.high_m[:2]) + 1e-9)).any(axis=-1)
    edges = np.flatnonzero(np.diff(out)) + 1
    return [run for run, is_out in zip(np.split(path, edges), np.split(out, edges), strict=True) if is_out.any()]

"""A lab from above as one SVG: fence, slots at the start, the leader's path and theirs, axes and a scale bar."""

from math import cos, floor, log10, sin
from xml.sax.saxutils import escape

import numpy as np

from formation.maths.arrays import Float
from gcs.lab.drawing import Drawing

SIDE, LEFT, TOP, RIGHT, BOTTOM = 640.0, 76.0, 88.0, 36.0, 104.0
GRID_LINES = 10.0
FENCE, LEADER, FOLLOWER, GRID, INK, QUIET = "#8a1c1c", "#1f4e9c", "#d9730d", "#e6e8eb", "#22262b", "#6b7280"
FAR_LABELS = 8  # more followers than this are not named
STYLE = (
    "text{font-family:Helvetica,Arial,'Liberation Sans',sans-serif;font-size:13px;fill:" + INK + "}"
    ".quiet{fill:" + QUIET + ";font-size:12px}.title{font-size:19px;font-weight:bold}"
    ".beyond{fill:" + FENCE + ";font-size:12px}"
)


def svg_plan(drawing: Drawing, subtitle: str) -> str:
    """The lab as the text of an SVG file: x forward is up, y left is to the left. subtitle: one line under the name."""
    sheet = _Sheet(drawing)
    parts = [
        *sheet.frame(drawing, subtitle),
        *sheet.grid(),
        '<g clip-path="url(#sheet)">',
        *sheet.fence(drawing),
        *sheet.paths(drawing),
        *sheet.axes(drawing),
        *sheet.bodies(drawing),
        "</g>",
        *sheet.scale_bar(),
        *sheet.legend(),
        "</svg>",
    ]
    return "\n".join(parts) + "\n"


class _Sheet:
    """The sheet's scale: pixels of a point of the lab."""

    def __init__(self, drawing: Drawing) -> None:
        low, high = drawing.bounds
        pad = 0.04 * float((high - low).max())
        self._low, self._high = low - pad, high + pad
        size = self._high - self._low
        self.px_m = SIDE / float(size.max())
        self.width, self.height = self.px_m * float(size[1]), self.px_m * float(size[0])
        self.step_m = _step(float(size.max()) / GRID_LINES)

    def at(self, point: Float) -> tuple[float, float]:
        """Pixels, right and down, of a point (2)."""
        return (
            LEFT + self.px_m * (float(self._high[1]) - float(point[1])),
            TOP + self.px_m * (float(self._high[0]) - float(point[0])),
        )

    def frame(self, drawing: Drawing, subtitle: str) -> list[str]:
        """The file's head, the title, and what may be drawn on."""
        width, height = max(LEFT + self.width + RIGHT, 600.0), TOP + self.height + BOTTOM
        return [
            f'<svg xmlns="http://www.w3.org/2000/svg" width="{width:.0f}" height="{height:.0f}" '
            f'viewBox="0 0 {width:.0f} {height:.0f}">',
            f"<title>{escape(drawing.name)} from above</title>",
            f"<style>{STYLE}</style>",
            f'<clipPath id="sheet"><rect x="{LEFT:.1f}" y="{TOP:.1f}" width="{self.width:.1f}" '
            f'height="{self.height:.1f}"/></clipPath>',
            f'<rect width="{width:.0f}" height="{height:.0f}" fill="#ffffff"/>',
            f'<text class="title" x="{LEFT:.1f}" y="34">{escape(drawing.name)}</text>',
            f'<text class="quiet" x="{LEFT:.1f}" y="58">{escape(subtitle)}</text>',
            f'<text class="beyond" x="{LEFT:.1f}" y="76">{escape(drawing.beyond)}</text>',
        ]

    def grid(self) -> list[str]:
        """Lines at round metres, with their numbers at the left (x) and below (y)."""
        parts, bottom = [], TOP + self.height
        for x in _rounds(float(self._low[0]), float(self._high[0]), self.step_m):
            _, down = self.at(np.array([x, 0.0]))
            parts.append(_line(LEFT, down, LEFT + self.width, down, GRID, 1.0))
            parts.append(f'<text class="quiet" x="{LEFT - 8:.1f}" y="{down + 4:.1f}" text-anchor="end">{x:g}</text>')
        for y in _rounds(float(self._low[1]), float(self._high[1]), self.step_m):
            right, _ = self.at(np.array([0.0, y]))
            parts.append(_line(right, TOP, right, bottom, GRID, 1.0))
            parts.append(f'<text class="quiet" x="{right:.1f}" y="{bottom + 18:.1f}" text-anchor="middle">{y:g}</text>')
        middle = TOP + 0.5 * self.height
        parts.append(
            f'<text class="quiet" x="24" y="{middle:.1f}" text-anchor="middle" '
            f'transform="rotate(-90 24 {middle:.1f})">x forward, m</text>'
        )
        across = LEFT + 0.5 * self.width
        parts.append(
            f'<text class="quiet" x="{across:.1f}" y="{bottom + 38:.1f}" text-anchor="middle">y left, m</text>'
        )
        return parts

    def fence(self, drawing: Drawing) -> list[str]:
        left, top = self.at(np.array(drawing.high_m[:2]))
        right, bottom = self.at(np.array(drawing.low_m[:2]))
        return [
            f'<rect x="{left:.1f}" y="{top:.1f}" width="{right - left:.1f}" height="{bottom - top:.1f}" '
            f'fill="{FENCE}" fill-opacity="0.025" stroke="{FENCE}" stroke-width="2.5"/>'
        ]

    def paths(self, drawing: Drawing) -> list[str]:
        """The slots' paths under the leader's; the parts outside the fence in the fence's colour."""
        parts = [self._path(path, FOLLOWER, 1.4, 0.45) for path in drawing.swept if _moves(path)]
        if _moves(drawing.path):
            parts += [self._path(drawing.path, LEADER, 2.4, 1.0), *self._direction(drawing.path)]
        for path in (*drawing.swept, drawing.path):
            parts += [self._path(run, FENCE, 3.0, 1.0) for run in _outside(path, drawing) if _moves(run)]
        return parts

    def axes(self, drawing: Drawing) -> list[str]:
        """A cross at the lab's origin, and which way its axes point, in the fence's corner."""
        right, down = self.at(np.zeros(2))
        cross = [_line(right - 6, down, right + 6, down, INK, 1.4), _line(right, down - 6, right, down + 6, INK, 1.4)]
        corner, floor_ = self.at(np.array(drawing.low_m[:2]))
        x, y, reach = corner - 20.0, floor_ - 20.0, 42.0
        return [
            *cross, *_arrow(x, y, 0.0, -reach, INK), *_arrow(x, y, -reach, 0.0, INK),
            f'<text class="quiet" x="{x - 7:.1f}" y="{y - reach + 2:.1f}" text-anchor="end">x forward</text>',
            f'<text class="quiet" x="{x - reach - 10:.1f}" y="{y + 4:.1f}" text-anchor="end">y left</text>',
        ]  # fmt: skip

    def bodies(self, drawing: Drawing) -> list[str]:
        """Everybody at the start, each in the circle that no two may share, and named."""
        half_px = 0.5 * self.px_m * drawing.min_separation_m
        parts = []
        for body, slot in zip(drawing.bodies[1:], drawing.slots, strict=True):
            right, down = self.at(slot)
            colour = FENCE if _outside(slot[None], drawing) else FOLLOWER
            parts.append(_ring(right, down, half_px, colour))
            parts.append(f'<circle cx="{right:.1f}" cy="{down:.1f}" r="4.5" fill="{colour}"/>')
            if len(drawing.slots) <= FAR_LABELS:
                parts.append(_label(right, down, max(half_px, 6.0), body, slot[1] - drawing.leader[1]))
        right, down = self.at(drawing.leader)
        dashed = ' stroke-dasharray="3 2" fill-opacity="0.25"' if drawing.observed else ""
        corners = _pointer(right, down, drawing.heading_rad)
        parts.append(_ring(right, down, half_px, LEADER))
        parts.append(f'<polygon points="{corners}" fill="{LEADER}" stroke="{LEADER}"{dashed}/>')
        parts.append(_label(right, down, max(half_px, 9.0), drawing.bodies[0], -1.0))
        return parts

    def scale_bar(self) -> list[str]:
        left, down = LEFT, TOP + self.height + 78.0
        right = left + self.px_m * self.step_m
        ends = [_line(x, down - 5.0, x, down + 5.0, INK, 1.5) for x in (left, right)]
        text = f'<text x="{right + 10:.1f}" y="{down + 4.5:.1f}">{self.step_m:g} m</text>'
        return [_line(left, down, right, down, INK, 1.5), *ends, text]

    def legend(self) -> list[str]:
        """The meaning of the lines, in a row."""
        down, right = TOP + self.height + 62.0, LEFT + self.px_m * self.step_m + 74.0
        items = [(FENCE, "", "fence"), (LEADER, "", "leader's path"), (FOLLOWER, "", "slots' paths")]
        items.append((QUIET, "3 3", "minimum separation"))
        parts = []
        for k, (colour, dashes, words) in enumerate(items):
            x, y = right + 150.0 * (k % 2), down + 22.0 * (k // 2)
            parts += [_line(x, y, x + 24.0, y, colour, 2.2, dashes),
                      f'<text class="quiet" x="{x + 32:.1f}" y="{y + 4:.1f}">{escape(words)}</text>']  # fmt: skip
        return parts

    def _path(self, path: Float, colour: str, width: float, opacity: float) -> str:
        """A path (k, 2) as one line, of points a pixel apart at least."""
        points: list[tuple[float, float]] = []
        for k, point in enumerate(path):
            at = self.at(point)
            if k in (0, len(path) - 1) or abs(at[0] - points[-1][0]) + abs(at[1] - points[-1][1]) >= 1.0:
                points.append(at)
        text = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
        return (
            f'<polyline points="{text}" fill="none" stroke="{colour}" stroke-width="{width:g}" '
            f'stroke-opacity="{opacity:g}" stroke-linejoin="round"/>'
        )

    def _direction(self, path: Float) -> list[str]:
        """An arrow head on the leader's path, an eighth of the length along."""
        far = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=-1))])
        k = min(int(np.searchsorted(far, min(0.125 * far[-1], 60.0 / self.px_m))), len(path) - 2)
        (x, y), (x1, y1) = self.at(path[k]), self.at(path[k + 1])
        size = float(np.hypot(x1 - x, y1 - y)) or 1.0
        return [f'<polygon points="{_head(x, y, (x1 - x) / size, (y1 - y) / size, 7.0)}" fill="{LEADER}"/>']


def _outside(path: Float, drawing: Drawing) -> list[Float]:
    """The parts of a path (k, 2) that are beyond the fence, seen from above."""
    out = ((path < np.array(drawing.low_m[:2]) - 1e-9) | (path > np.array(drawing.high_m[:2]) + 1e-9)).any(axis=-1)
    edges = np.flatnonzero(np.diff(out)) + 1
    return [run for run, is_out in zip(np.split(path, edges), np.split(out, edges), strict=True) if is_out.any()]


def _moves(path: Float) -> bool:
    return float(np.ptp(path, axis=0).max()) > 1e-6


def _step(about: float) -> float:
    """The round number, 1, 2 or 5 times a power of ten, next above."""
    power = 10.0 ** floor(log10(about))
    return next(m * power for m in (1.0, 2.0, 5.0, 10.0) if m * power >= about - 1e-12)


def _rounds(low: float, high: float, step: float) -> list[float]:
    return [round(k * step, 9) for k in range(int(np.ceil(low / step)), int(np.floor(high / step)) + 1)]


def _line(x0: float, y0: float, x1: float, y1: float, colour: str, width: float, dashes: str = "") -> str:
    dashed = f' stroke-dasharray="{dashes}"' if dashes else ""
    ends = f'x1="{x0:.1f}" y1="{y0:.1f}" x2="{x1:.1f}" y2="{y1:.1f}"'
    return f'<line {ends} stroke="{colour}" stroke-width="{width:g}"{dashed}/>'


def _ring(x: float, y: float, radius: float, colour: str) -> str:
    return (
        f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{radius:.1f}" fill="{colour}" fill-opacity="0.07" stroke="{colour}" '
        f'stroke-width="1" stroke-dasharray="3 3"/>'
    )


def _arrow(x: float, y: float, dx: float, dy: float, colour: str) -> list[str]:
    size = float(np.hypot(dx, dy))
    head = _head(x + dx, y + dy, dx / size, dy / size, 6.0)
    return [_line(x, y, x + dx, y + dy, colour, 1.4), f'<polygon points="{head}" fill="{colour}"/>']


def _head(x: float, y: float, ux: float, uy: float, size: float) -> str:
    """Corners of an arrow head about (x, y) that points along the unit vector u."""
    corners = [(size, 0.0), (-0.6 * size, 0.7 * size), (-0.6 * size, -0.7 * size)]
    return " ".join(f"{x + a * ux - b * uy:.1f},{y + a * uy + b * ux:.1f}" for a, b in corners)


def _pointer(x: float, y: float, heading_rad: float) -> str:
    """The leader: it points where it heads; forward is up, left is left."""
    return _head(x, y, -sin(heading_rad), -cos(heading_rad), 10.0)


def _label(x: float, y: float, away: float, text: str, leftness: float) -> str:
    """A name beside its mark, on the left of one that is left of the leader."""
    left = leftness > 1e-6
    at = x - away - 5.0 if left else x + away + 5.0
    return f'<text x="{at:.1f}" y="{y + 4.5:.1f}" text-anchor="{"end" if left else "start"}">{escape(text)}</text>'

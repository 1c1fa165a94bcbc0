"""The page's views as HTML and SVG: the room by two cameras, then tables and words. Pure.

Whatever drones, logs and people said is escaped.
"""

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from html import escape

from formation.config import Fence
from formation.messages import Severity, Verb
from formation.safety.phases import PHASES_FOR
from formation.security_config import MAY_ASK, Role
from gcs.alarms import folded
from gcs.page.scene import Body, Point, Scene
from gcs.page.show import ABOUT, COLUMNS, LABELS, UNITS, Cell, Level, Show, Step, not_landed_text, worst
from wire.ground_state import Alarm

NEAREST_M = 0.1
Row = tuple[float, float, float, float]
LEADER, FOLLOWER, BAD = "#F0E442", "#56B4E9", "#FF7A33"
SMALLEST_PX = 7.0
"""Radius of a drone in the picture that can still be seen; a smaller one has a ring of that size around it."""
CIRCLE = tuple((math.cos(k * math.pi / 12), math.sin(k * math.pi / 12)) for k in range(24))
Box = tuple[float, float, float, float]
"""Left, top, right and bottom, px."""


@dataclass(frozen=True, slots=True)
class Camera:
    """A picture of width by height. right, up, ahead: rows that give a point's camera coordinates, m.

    A metre one metre ahead is focal pixels large; from above, everything is one metre ahead.
    """

    width: float
    height: float
    right: Row
    up: Row
    ahead: Row
    focal: float

    def project(self, x: float, y: float, z: float) -> tuple[float, float, float]:
        """Pixel coordinates of a point of the lab, and the size of a metre there, px. Called for every drawn point."""
        a, u, r = self.ahead, self.up, self.right
        scale = self.focal / max(a[0] * x + a[1] * y + a[2] * z + a[3], NEAREST_M)
        return (
            0.5 * self.width + scale * (r[0] * x + r[1] * y + r[2] * z + r[3]),
            0.5 * self.height - scale * (u[0] * x + u[1] * y + u[2] * z + u[3]),
            scale,
        )


def above(fence: Fence, width: float, height: float, margin_m: float = 0.3) -> Camera:
    """From above: lab x to the right, y up, as large as the fence with a margin allows."""
    (x0, y0, _), (x1, y1, _) = fence.low_m, fence.high_m
    focal = min(width / (x1 - x0 + 2.0 * margin_m), height / (y1 - y0 + 2.0 * margin_m))
    right, up = (1.0, 0.0, 0.0, -0.5 * (x0 + x1)), (0.0, 1.0, 0.0, -0.5 * (y0 + y1))
    return Camera(width, height, right, up, (0.0, 0.0, 0.0, 1.0), focal)


@dataclass(frozen=True, slots=True)
class Stand:
    """From where a person looks into the room: about lab z from lab x, above the floor, and how far off.

    away: factor on the distance that shows all of the fence.
    """

    azimuth_rad: float = -2.2
    elevation_rad: float = 0.5
    away: float = 1.0

    def turned(self, right_rad: float, up_rad: float) -> "Stand":
        """The same from elsewhere; never from under the floor."""
        return Stand(self.azimuth_rad + right_rad, min(max(self.elevation_rad + up_rad, 0.05), 1.5), self.away)

    def nearer(self, factor: float) -> "Stand":
        """The same from another distance."""
        return Stand(self.azimuth_rad, self.elevation_rad, min(max(self.away * factor, 0.3), 2.0))


def perspective(fence: Fence, stand: Stand, width: float, height: float, filled: float = 0.92) -> Camera:
    """Looking at the middle of the room, which fills that share of the picture: names stand outside it."""
    low, high = (*fence.low_m[:2], max(fence.low_m[2], 0.0)), fence.high_m
    mx, my, mz = (0.5 * (a + b) for a, b in zip(low, high, strict=True))
    reach_m = 0.5 * math.dist(low, high)
    ca, sa = math.cos(stand.azimuth_rad), math.sin(stand.azimuth_rad)
    ce, se = math.cos(stand.elevation_rad), math.sin(stand.elevation_rad)

    def row(x: float, y: float, z: float, shift: float = 0.0) -> Row:
        return x, y, z, shift - (x * mx + y * my + z * mz)

    right, up, away_m = row(-sa, ca, 0.0), row(-ca * se, -sa * se, ce), 3.0 * reach_m
    usual = Camera(0.0, 0.0, right, up, row(-ca * ce, -sa * ce, -se, away_m), 1.0)
    corners = [usual.project(x, y, z) for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])]
    (left, top), (end, bottom) = ([pick(c[k] for c in corners) for k in (0, 1)] for pick in (min, max))
    focal = filled * min(width / (end - left), height / (bottom - top))
    ahead = row(-ca * ce, -sa * ce, -se, away_m * stand.away)
    across, down = -0.5 * (left + end), 0.5 * (top + bottom)  # puts the room's outline into the middle of the picture
    return Camera(width, height, _sum(right, ahead, across), _sum(up, ahead, down), ahead, focal)


def _sum(one: Row, other: Row, times: float) -> Row:
    a, b, c, d = (x + times * y for x, y in zip(one, other, strict=True))
    return a, b, c, d


def still(camera: Camera, fence: Fence) -> str:
    """The floor's grid, a line every metre or half of it, the fence, and where lab x and y point."""
    (x0, y0, z0), (x1, y1, z1) = fence.low_m, fence.high_m
    floor = max(z0, 0.0)
    step = 0.5 if max(x1 - x0, y1 - y0) <= 8.0 else 1.0
    lines = [_line(camera, (x, y0, floor), (x, y1, floor), "grid") for x in _every(step, x0, x1)]
    lines += [_line(camera, (x0, y, floor), (x1, y, floor), "grid") for y in _every(step, y0, y1)]
    box = [(x, y, z) for x in (x0, x1) for y in (y0, y1) for z in (floor, z1)]
    for i, one in enumerate(box):
        lines += [_line(camera, one, box[j], "fence") for j in range(i) if _differ(one, box[j]) == 1]
    for name, end, (x, y) in _axes(camera):
        lines.append(_line(camera, (0.0, 0.0, 0.0), end, "axis"))
        lines.append(f'<text class="axist" x="{x:.1f}" y="{y:.1f}">{name}</text>')
    return "".join(lines)


def _axes(camera: Camera) -> Iterator[tuple[str, Point, tuple[float, float]]]:
    """Of the lab's x and y, half a metre long: name, end, and where in the picture the name stands."""
    for name, end in (("x", (0.5, 0.0, 0.0)), ("y", (0.0, 0.5, 0.0))):
        x, y, _ = camera.project(*end)
        yield name, end, (x, y - 4.0)


def moving(camera: Camera, shown: Scene, crowd: bool = False) -> str:
    """Trails, slots, references, keep-outs, pairs that are near, and the drones.

    crowd: only the leader, and who is in trouble, is named.
    """
    parts = [_trail(camera, body) for body in shown.bodies if len(body.trail_lab_m) > 1]
    covered: list[Box] = []
    for name, _, (x, y) in _axes(camera):
        _placed(covered, x, y, name)
    for body in shown.bodies:
        x, y, scale = camera.project(*body.pos_lab_m)
        r = max(0.5 * body.size_m * scale, SMALLEST_PX)
        covered.append((x - r, y - r, x + r, y + r))
    parts += [_ring(camera, point, radius, "keepout") for point, radius in shown.keep_outs]
    slots = [camera.project(*point) for point in shown.slots_lab_m]
    parts += [f'<circle class="slot" cx="{x:.1f}" cy="{y:.1f}" r="12"/>' for x, y, _ in slots]
    texts: list[tuple[float, float, str]] = []
    for i, j, distance_m in shown.pairs:
        one, other = shown.bodies[i].pos_lab_m, shown.bodies[j].pos_lab_m
        middle = (0.5 * (one[0] + other[0]), 0.5 * (one[1] + other[1]), 0.5 * (one[2] + other[2]))
        parts.append(_line(camera, one, other, "near"))
        texts.append((*camera.project(*middle)[:2], f"{distance_m:.2f} m"))
    led = [(body.pos_lab_m, body.reference_lab_m) for body in shown.bodies if body.reference_lab_m is not None]
    for at, reference in led:
        x, y, _ = camera.project(*reference)
        parts.append(_line(camera, at, reference, "off"))
        parts.append(f'<path class="ref" d="M{x - 5:.1f} {y:.1f}h10M{x:.1f} {y - 5:.1f}v10"/>')
    for body in shown.bodies:
        parts.append(_drone(camera, body, covered if not crowd or body.leader or _troubled(body) else None))
    for x, y, text in texts:
        x, y = _placed(covered, x, y - 4.0, text)
        parts.append(f'<text class="neart" x="{x:.1f}" y="{y:.1f}">{text}</text>')
    return "".join(parts)


def svg(camera: Camera, inside: str, about: str) -> str:
    """A whole picture; about: for those who hear it read."""
    box = f"0 0 {camera.width:g} {camera.height:g}"
    return f'<svg viewBox="{box}" role="img" aria-label="{escape(about)}">{inside}</svg>'


def _colour(body: Body) -> str:
    if _troubled(body):
        return BAD
    return LEADER if body.leader else FOLLOWER


def _troubled(body: Body) -> bool:
    return body.rejected or not body.seen


def _placed(covered: list[Box], x: float, y: float, text: str, past: float = 0.0) -> tuple[float, float]:
    """Where a text covers none of those before it, as near to x, its middle, and the baseline y as it can be.

    past: the radius of what it names, px, from which y is a line's height down: it may stand above it or beside it.
    """
    letter_px, line_px = 8.0, 15.0  # of texts that are 13 px high in page.css
    half = 0.5 * letter_px * len(text)
    up, aside = -2.0 * past - 1.2 * line_px, half + past + letter_px
    beside = [(0.0, up), (aside, 0.5 * up), (-aside, 0.5 * up)]
    away = [(0.0, sign * k * line_px) for k in range(1, 6) for sign in (1.0, -1.0)]
    for dx, dy in ((0.0, 0.0), *beside, *away):
        box = (x + dx - half, y + dy - 0.8 * line_px, x + dx + half, y + dy + 0.2 * line_px)
        if not any(box[0] < b[2] and b[0] < box[2] and box[1] < b[3] and b[1] < box[3] for b in covered):
            covered.append(box)
            return x + dx, y + dy
    return x, y


def _drone(camera: Camera, body: Body, covered: list[Box] | None) -> str:
    """A quadcopter of its true size and attitude, its nose as a line, its shadow on the floor, its name.

    covered: where other texts are; None for a drone that is not named.
    """
    arm = 0.5 * body.size_m
    d = math.sqrt(0.5) * arm
    tips = [_tip(camera, body, sx * d, sy * d) for sx, sy in ((1, 1), (1, -1), (-1, -1), (-1, 1))]
    nx, ny, _ = _tip(camera, body, 1.6 * arm, 0.0)
    x, y, scale = camera.project(*body.pos_lab_m)
    sx, sy, _ = camera.project(body.pos_lab_m[0], body.pos_lab_m[1], 0.0)
    colour, rotor = _colour(body), max(0.38 * arm * scale, 1.5)
    parts = [f'<g class="drone" stroke="{colour}" fill="{colour if body.armed else "none"}">']
    if abs(sy - y) > 2.0:
        parts.append(f'<path class="drop" d="M{x:.1f} {y:.1f}L{sx:.1f} {sy:.1f}"/>')
        parts.append(f'<ellipse class="shadow" cx="{sx:.1f}" cy="{sy:.1f}" rx="4" ry="2"/>')
    arms = "".join(f"M{x:.1f} {y:.1f}L{px:.1f} {py:.1f}" for px, py, _ in tips)
    if arm * scale < SMALLEST_PX:
        parts.append(f'<circle class="ring" cx="{x:.1f}" cy="{y:.1f}" r="{SMALLEST_PX}"/>')
        length = max(math.hypot(nx - x, ny - y), 1e-9)
        nx, ny = x + (nx - x) * 1.8 * SMALLEST_PX / length, y + (ny - y) * 1.8 * SMALLEST_PX / length
    parts.append(f'<path class="nose" d="{arms}M{x:.1f} {y:.1f}L{nx:.1f} {ny:.1f}"/>')
    parts += [f'<circle cx="{px:.1f}" cy="{py:.1f}" r="{rotor:.1f}"/>' for px, py, _ in tips]
    if covered is not None:
        name, past = body.name + (" ✖" if _troubled(body) else ""), max(arm * scale, SMALLEST_PX)
        x, y = _placed(covered, x, y + past + 14.0, name, past)
        parts.append(f'<text x="{x:.1f}" y="{y:.1f}">{escape(name)}</text>')
    parts.append("</g>")
    return "".join(parts)


def _tip(camera: Camera, body: Body, x: float, y: float) -> tuple[float, float, float]:
    """Where a point of the body's own plane, x forward, y left, is in the picture."""
    w, i, j, k = body.q_lab_from_flu
    px, py, pz = body.pos_lab_m
    return camera.project(
        px + (1.0 - 2.0 * (j * j + k * k)) * x + 2.0 * (i * j - w * k) * y,
        py + 2.0 * (i * j + w * k) * x + (1.0 - 2.0 * (i * i + k * k)) * y,
        pz + 2.0 * (i * k - w * j) * x + 2.0 * (j * k + w * i) * y,
    )


def _every(step: float, low: float, high: float) -> list[float]:
    return [k * step for k in range(math.ceil(low / step), math.floor(high / step) + 1)]


def _differ(one: Point, other: Point) -> int:
    return sum(a != b for a, b in zip(one, other, strict=True))


def _line(camera: Camera, a: Point, b: Point, name: str) -> str:
    (x0, y0, _), (x1, y1, _) = camera.project(*a), camera.project(*b)
    return f'<path class="{name}" d="M{x0:.1f} {y0:.1f}L{x1:.1f} {y1:.1f}"/>'


def _points(camera: Camera, points: Iterable[Point]) -> str:
    pixels = [camera.project(*point) for point in points]
    return " ".join([f"{x:.0f},{y:.0f}" for x, y, _ in pixels])


def _trail(camera: Camera, body: Body) -> str:
    return f'<polyline class="trail" points="{_points(camera, body.trail_lab_m)}" stroke="{_colour(body)}"/>'


def _ring(camera: Camera, point: Point, radius_m: float, name: str) -> str:
    x, y, z = point
    ring = _points(camera, [(x + radius_m * c, y + radius_m * s, z) for c, s in CIRCLE])
    return f'<polygon class="{name}" points="{ring}"/>'


_MARK = {Level.CALM: "", Level.WARN: "▲ ", Level.BAD: "✖ "}
_CLASS = {Level.CALM: "", Level.WARN: ' class="warn"', Level.BAD: ' class="bad"'}


def head(shown: Show) -> str:
    """Phase, for how long, and why; countdowns beside it, and who is left out."""
    texts = (*shown.countdowns, *((shown.left_out,) if shown.left_out else ()))
    left = "".join(f'<span class="countdown">{escape(text)}</span>' for text in texts)
    name = "-" if shown.phase is None else shown.phase.name
    phase = "phase p-aloft" if shown.not_landed else f"phase p-{name.lower()}"
    aloft = f'<span class="aloft">✖ {escape(not_landed_text(shown.not_landed))}</span> ' if shown.not_landed else ""
    return (
        f'<div class="{phase}">{name}</div>'
        f'<div class="cause">{aloft}<b>{escape(shown.since)}</b> {escape(shown.cause)}<br>{left}</div>'
    )


def vital(shown: Show) -> str:
    """The machines in short."""
    return "".join(
        f"<div><i>{escape(name)}</i><span{_CLASS[cell.level]}>{_MARK[cell.level]}{escape(cell.text)}</span></div>"
        for name, cell in shown.vital
    )


def table(shown: Show) -> str:
    """One row a drone."""
    heads = "".join(
        f'<th title="{escape(about)}">{name}<small>{unit}</small></th>'
        for name, unit, about in zip(COLUMNS, UNITS, ABOUT, strict=True)
    )
    rows = "".join(
        f'<tr tabindex="0" class="r{int(worst(row))}">' + "".join(map(_cell, row)) + "</tr>" for row in shown.rows
    )
    return f"<table><thead><tr>{heads}</tr></thead><tbody>{rows}</tbody></table>"


def steps(shown: Show, commands: bool) -> str:
    """For what is not allowed, every reason; what is only out of turn in few words."""
    texts = [_against(step) for step in shown.steps if step.reasons and not step.is_idle]
    turn = [
        f"{LABELS[step.verb]}: only in {', '.join(phase.name for phase in PHASES_FOR[step.verb])}"
        for step in shown.steps
        if step.out_of_turn
    ]
    turn += [
        f"{LABELS[step.verb]}: {escape('; '.join(step.reasons))}"
        for step in shown.steps
        if step.reasons and step.is_idle and not step.out_of_turn
    ]
    later = f'<p class="later">{"<br>".join(turn)}</p>' if turn and commands else ""
    return "".join(texts) + later


def alarms(open_: Sequence[Alarm], latest: Sequence[Alarm]) -> str:
    """Those that are not acknowledged and over, cleared ones folded; without any, the newest events, dimmed."""
    standing, others = folded(open_)
    cleared = "".join(map(_event, (alarm for alarm in open_ if alarm.cleared)))
    fold = f'<details class="event"><summary>{others}</summary>{cleared}</details>' if others else ""
    return "".join(map(_alarm, standing)) + fold if open_ else "".join(map(_event, latest))


def lost(shown: Show) -> str:
    """The words across the whole page; empty while the ground is heard."""
    if not shown.lost:
        return ""
    return f"<h1>NO CONNECTION TO THE GROUND</h1><p>{escape(shown.lost)}</p><p>What is shown is old.</p>"


def _against(step: Step) -> str:
    reasons = "".join(f"<li>{escape(reason)}</li>" for reason in step.reasons)
    return f'<p class="not">{LABELS[step.verb]} is not possible:</p><ul>{reasons}</ul>'


def _alarm(alarm: Alarm) -> str:
    name = "bad" if alarm.severity <= Severity.ERROR else "warn"
    name += " read" if alarm.acknowledged else ""
    mark = "✖" if alarm.severity <= Severity.ERROR else "▲"
    times = f" ({alarm.times} times)" if alarm.times > 1 else ""
    still = (", goes on" if alarm.goes_on else "") + (", acknowledged" if alarm.acknowledged else "")
    return (
        f'<div class="alarm {name}"><b>{mark} {alarm.level.name} {alarm.time}</b> '
        f"{escape(alarm.source)}: {escape(alarm.text)}{times}{still}</div>"
    )


def _event(alarm: Alarm) -> str:
    return f'<p class="event">{alarm.time} {escape(alarm.source)}: {escape(alarm.text)}</p>'


def _cell(cell: Cell) -> str:
    return f"<td{_CLASS[cell.level]}>{_MARK[cell.level]}{escape(cell.text)}</td>"


def plain(text: str) -> str:
    """Words as they are."""
    return escape(text)


def visitor(name: str, role: Role) -> str:
    """Who is logged in, what that role may do, and the way out."""
    may = ", ".join(verb.command_name for verb in Verb if verb in MAY_ASK[role] and verb is not Verb.STATUS)
    may = "everything" if role is Role.OPERATOR else f"only {may}"
    return f'{escape(name)}, {role}: may ask for {may}. <a href="/logout">Log out</a>'


def stopped(shown: Show) -> str:
    """The effect of a stop."""
    return escape(shown.stop)

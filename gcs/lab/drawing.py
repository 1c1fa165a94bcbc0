"""A lab from above: what is drawn, in metres of the lab, and the drawing as plain text of 80 columns."""

import string
from dataclasses import dataclass

import numpy as np

from formation.config import LabConfig
from formation.guidance.preview import Preview
from formation.maths.arrays import Float, Vec3s
from formation.model import Vec3Tuple


@dataclass(frozen=True, slots=True, eq=False)
class Drawing:
    """The lab from above: x forward is up on the sheet, y left is to the left.

    low_m, high_m: the fence; leader (2), slots (n, 2): at the start; path (k, 2): the leader's; swept (n, k, 2):
    the slots' paths; heading_rad: the leader's at the start; bodies: the names, leader first.
    """

    name: str
    bodies: tuple[str, ...]
    observed: bool
    low_m: Vec3Tuple
    high_m: Vec3Tuple
    leader: Float
    heading_rad: float
    slots: Vec3s
    path: Float
    swept: Float
    min_separation_m: float

    @property
    def bounds(self) -> tuple[Float, Float]:
        """The corners (2), (2) of what is shown: the fence, and what is outside of it as far as half its size."""
        low, high = np.array(self.low_m[:2]), np.array(self.high_m[:2])
        points = np.concatenate([self.path, self.swept.reshape(-1, 2), self.slots, [self.leader]])
        beyond = 0.5 * float((high - low).max())
        return (
            np.maximum(np.minimum(points.min(axis=0), low), low - beyond),
            np.minimum(np.maximum(points.max(axis=0), high), high + beyond),
        )

    @property
    def beyond(self) -> str:
        """Who is not on the sheet at the start, in words; nothing where all are."""
        low, high = self.bounds
        at = zip(self.bodies, [self.leader, *self.slots], strict=True)
        names = [body for body, point in at if (point < low).any() or (point > high).any()]
        return f"beyond the drawing: {', '.join(names)}" if names else ""


def drawn(config: LabConfig, ahead: Preview) -> Drawing:
    """The drawing of a lab and its formation phase."""
    return Drawing(
        name=config.name,
        bodies=tuple(v.body for v in config.vehicles),
        observed=config.leader.sysid is None,
        low_m=config.limits.fence.low_m,
        high_m=config.limits.fence.high_m,
        leader=ahead.start[:2],
        heading_rad=float(ahead.start[3]),
        slots=ahead.at_start[:, :2],
        path=ahead.leader[:, 0, :2],
        swept=np.moveaxis(ahead.slots[:, :, 0, :2], 1, 0),
        min_separation_m=config.limits.min_separation_m,
    )


COLUMNS, ROWS = 70, 24
TALL = 2.0  # a character's height in its widths
MARGIN = 8
LEADER, OBSERVED, LEADER_PATH, SLOT_PATH, ORIGIN = "L", "O", "o", ".", "+"
NAMES = string.digits[1:] + string.ascii_lowercase.replace("o", "") + string.ascii_uppercase.replace("L", "")


def text_plan(drawing: Drawing) -> str:
    """The lab as lines of text: x forward is up, y left is to the left."""
    sheet = _Sheet(drawing)
    sheet.fence(drawing)
    sheet.mark(np.zeros(2), ORIGIN)
    for path in drawing.swept:
        sheet.line(path, SLOT_PATH)
    sheet.line(drawing.path, LEADER_PATH)
    for name, slot in zip(_names(len(drawing.slots)), drawing.slots, strict=True):
        sheet.mark(slot, name)
    sheet.mark(drawing.leader, OBSERVED if drawing.observed else LEADER)
    return "\n".join([*sheet.lines(), *_legend(drawing)])


class _Sheet:
    """Characters in rows; a point of the lab has a row and a column, or is beyond the sheet."""

    def __init__(self, drawing: Drawing) -> None:
        self._low, self._high = drawing.bounds
        size = self._high - self._low
        self.metres = max(float(size[1]) / (COLUMNS - 1), float(size[0]) / (TALL * (ROWS - 1)))
        rows, columns = self._cell(self._low)
        self._rows = [[" "] * (columns + 1) for _ in range(rows + 1)]

    def _cell(self, point: Float) -> tuple[int, int]:
        down, right = (self._high - point) / self.metres
        return round(down / TALL), round(right)

    def mark(self, point: Float, character: str) -> None:
        """One character; nothing beyond the sheet."""
        row, column = self._cell(point)
        if 0 <= row < len(self._rows) and 0 <= column < len(self._rows[0]):
            self._rows[row][column] = character

    def line(self, points: Float, character: str) -> None:
        """A path (k, 2), closely sampled."""
        for point in points:
            self.mark(point, character)

    def fence(self, drawing: Drawing) -> None:
        top, left = self._cell(np.array(drawing.high_m[:2]))
        bottom, right = self._cell(np.array(drawing.low_m[:2]))
        for row in range(top, bottom + 1):
            edge = "+" if row in (top, bottom) else "|"
            self._rows[row][left] = self._rows[row][right] = edge
            if row in (top, bottom):
                self._rows[row][left + 1 : right] = "-" * (right - left - 1)

    def lines(self) -> list[str]:
        """All rows, heights of x on the left, y below, and a bar that is so many metres long."""
        middle = "x m" if len(self._rows) > 4 else ""
        labels = {0: f"{self._high[0]:.1f}", len(self._rows) // 2: middle, len(self._rows) - 1: f"{self._low[0]:.1f}"}
        drawn = [f"{labels.get(k, ''):>{MARGIN - 1}} {''.join(row)}".rstrip() for k, row in enumerate(self._rows)]
        width = len(self._rows[0])
        left, right = f"{self._high[1]:.1f}", f"{self._low[1]:.1f}"
        below = left + "y m".center(max(width - len(left) - len(right), 3)) + right
        round_m = (first * 10.0**power for power in range(-1, 3) for first in (1.0, 2.0, 5.0))
        bar_m = max((m for m in round_m if m / self.metres <= 0.4 * width), default=0.1)
        bar = "|" + "-" * max(round(bar_m / self.metres) - 1, 1) + f"| {bar_m:g} m"
        return [*drawn, " " * MARGIN + below, " " * MARGIN + bar]


def _names(n: int) -> list[str]:
    return [NAMES[k % len(NAMES)] for k in range(n)]


def _legend(drawing: Drawing) -> list[str]:
    """Who is who, a line full at a time."""
    leader, *followers = drawing.bodies
    who = f"{OBSERVED} {leader} (observed, taken to be here)" if drawing.observed else f"{LEADER} {leader}"
    items = [who, *(f"{name} {body}" for name, body in zip(_names(len(followers)), followers, strict=True))]
    items += [f"{LEADER_PATH} leader's path", f"{SLOT_PATH} slots' paths", f"{ORIGIN} origin"]
    lines, line = [], ""
    for item in items:
        if line and len(line) + 2 + len(item) > COLUMNS:
            lines.append(line)
            line = ""
        line = f"{line}  {item}" if line else item
    lines.append(line)
    legend = ["from above: x forward is up, y left is to the left", *lines, drawing.beyond]
    return [" " * MARGIN + text for text in legend if text]

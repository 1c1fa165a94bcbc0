"""Two cameras on the room, from above and in perspective; each puts points of `lab` on a picture. Pure."""

import math
from dataclasses import dataclass

from formation.config import Fence

MARGIN_M = 0.3
NEAREST_M = 0.1
Row = tuple[float, float, float, float]


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


def above(fence: Fence, width: float, height: float) -> Camera:
    """From above: lab x to the right, y up, as large as the fence with a margin allows."""
    (x0, y0, _), (x1, y1, _) = fence.low_m, fence.high_m
    focal = min(width / (x1 - x0 + 2.0 * MARGIN_M), height / (y1 - y0 + 2.0 * MARGIN_M))
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


def perspective(fence: Fence, stand: Stand, width: float, height: float) -> Camera:
    """Looking at the middle of the room."""
    low, high = (*fence.low_m[:2], max(fence.low_m[2], 0.0)), fence.high_m
    mx, my, mz = (0.5 * (a + b) for a, b in zip(low, high, strict=True))
    reach_m = 0.5 * math.dist(low, high)
    ca, sa = math.cos(stand.azimuth_rad), math.sin(stand.azimuth_rad)
    ce, se = math.cos(stand.elevation_rad), math.sin(stand.elevation_rad)

    def row(x: float, y: float, z: float, shift: float = 0.0) -> Row:
        return x, y, z, shift - (x * mx + y * my + z * mz)

    away_m = 3.0 * reach_m * stand.away
    focal = 1.6 * min(height, width / 1.15)
    return Camera(
        width, height, row(-sa, ca, 0.0), row(-ca * se, -sa * se, ce), row(-ca * ce, -sa * ce, -se, away_m), focal
    )

"""The named shapes: where n slots are in the leader's frame, neighbours `spacing_m` apart. Pure geometry.

Every pattern keeps all slots, and the leader at the origin, at least spacing_m apart.
"""

from collections.abc import Callable, Mapping
from math import ceil, pi, sin, sqrt
from types import MappingProxyType

import numpy as np

from formation.maths.arrays import Float, Vec3s

Pattern = Callable[[int, float], Vec3s]
"""(n, spacing_m) -> slots (n, 3) in the leader's frame, m."""


def line(n: int, spacing_m: float) -> Vec3s:
    """Abreast of the leader, left and right of it in turn."""
    return spacing_m * np.array([(0.0, _side(k) * (k // 2 + 1), 0.0) for k in range(n)])


def column(n: int, spacing_m: float) -> Vec3s:
    """One behind the other."""
    return spacing_m * np.array([(-k, 0.0, 0.0) for k in range(1, n + 1)])


def vee(n: int, spacing_m: float) -> Vec3s:
    """Two arms swept back by 45 degrees from the leader, filled in turn."""
    step = spacing_m / sqrt(2.0)
    return step * np.array([(-(k // 2 + 1), _side(k) * (k // 2 + 1), 0.0) for k in range(n)])


def triangle(n: int, spacing_m: float) -> Vec3s:
    """Rows of two, three, four... behind the leader, all triangles equilateral; the last row fills from its middle."""
    slots: list[tuple[float, float, float]] = []
    row = 1
    while len(slots) < n:
        columns_y = sorted((k - 0.5 * row for k in range(row + 1)), key=lambda y: (abs(y), -y))
        slots += [(-0.5 * sqrt(3.0) * row, y, 0.0) for y in columns_y]
        row += 1
    return spacing_m * np.array(slots[:n])


def circle(n: int, spacing_m: float) -> Vec3s:
    """Evenly round the leader, the first ahead of it; neighbours and leader at least spacing_m away."""
    radius_m = spacing_m * max(1.0, 0.5 / sin(pi / n)) if n > 1 else spacing_m
    angle: Float = 2.0 * pi * np.arange(n) / n
    return radius_m * np.column_stack([np.cos(angle), np.sin(angle), np.zeros(n)])


def grid(n: int, spacing_m: float) -> Vec3s:
    """Rows behind the leader, as many columns as rows or one more; the last row fills from its middle."""
    columns = ceil(sqrt(n))
    columns_y = sorted((k - 0.5 * (columns - 1) for k in range(columns)), key=lambda y: (abs(y), -y))
    return spacing_m * np.array([(-(k // columns + 1.0), columns_y[k % columns], 0.0) for k in range(n)])


def _side(k: int) -> float:
    """Left, right, left, right..."""
    return 1.0 if k % 2 == 0 else -1.0


PATTERNS: Mapping[str, Pattern] = MappingProxyType(
    {"triangle": triangle, "line": line, "column": column, "v": vee, "circle": circle, "grid": grid}
)

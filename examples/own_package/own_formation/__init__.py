"""A lab's own leader trajectory and formation shape, and in `cascade` its own control law.

`pyproject.toml` beside it registers them by name.
"""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def helix(
    radius_m: float = 0.4, period_s: float = 8.0, climb_m: float = 0.3, laps: int = 2, low_m: float = 0.3
) -> Array:
    """Rows of t, x, y, z, yaw: rounds about the lab's origin, each climb_m higher, the heading along the way.

    The angle is a minimum-jerk step (Flash and Hogan 1985), so that it begins and ends at rest.
    """
    duration_s = laps * period_s
    t_s = np.linspace(0.0, duration_s, round(20.0 * duration_s) + 1)
    u = t_s / duration_s
    turned = u**3 * (10.0 - 15.0 * u + 6.0 * u**2)
    angle = 2.0 * np.pi * laps * turned
    x, y, z = radius_m * np.cos(angle), radius_m * np.sin(angle), low_m + climb_m * laps * turned
    return np.column_stack([t_s, x, y, z, angle + 0.5 * np.pi])


def diamond(n: int, spacing_m: float) -> Array:
    """Slots (n, 3) behind the leader, on the corners of ever larger squares that stand on a corner."""
    corners = np.array([(-1.0, 1.0, 0.0), (-1.0, -1.0, 0.0), (-2.0, 0.0, 0.0)])
    return np.array([spacing_m * (corners[k % 3] - (2.0 * (k // 3), 0.0, 0.0)) for k in range(n)])

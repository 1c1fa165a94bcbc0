"""The one way a reference changes its mind: the gap to the new course decays along a quintic, from any motion to none.

Position, velocity and acceleration stay continuous, and after `duration` the gap is exactly zero. On the way it may
make a detour: a bump that begins and ends at rest.

A gap is an array (4, 4): columns x, y, z, heading; rows position, velocity, acceleration when it began, and the
detour half-way.
"""

from math import sqrt

import numpy as np

from formation.arrays import Float
from formation.kernel import kernel

SHORTEST_S = 0.6
ACCELERATION_M_S2 = 2.5
TURN_RAD_S = 1.0
PEAK_SPEED, PEAK_ACCELERATION = 1.875, 5.7735  # of a minimum-jerk step of unit length and duration
BUMP_SPEED, BUMP_ACCELERATION = 3.4346, 24.0  # of a detour of unit height and duration


def closing_s(gap: Float, speed_max: float) -> float:
    """How long a gap (4, 4) should take to close: its peaks stay under speed_max, a gentle acceleration and turn."""
    distance, speed, _, detour = (float(size) for size in np.linalg.norm(gap[:, :3], axis=1))
    return max(
        (PEAK_SPEED * distance + BUMP_SPEED * detour) / speed_max,
        sqrt((PEAK_ACCELERATION * distance + BUMP_ACCELERATION * detour) / ACCELERATION_M_S2),
        2.0 * speed / ACCELERATION_M_S2,
        PEAK_SPEED * abs(float(gap[0, 3])) / TURN_RAD_S,
        SHORTEST_S,
    )


@kernel
def add_gap(gap: Float, elapsed_s: float, duration_s: float, out: Float) -> None:
    """Adds to the motion `out` (3, 4) what is left after elapsed_s of the gap (4, 4) it began with.

    The quintic meets the gap at 0 and rest at zero at duration_s; the detour is 64 u^3 (1 - u)^3 of its height.
    """
    if elapsed_s >= duration_s:
        return
    t, d = max(elapsed_s, 0.0), duration_s
    u = t / d
    for i in range(4):
        p, v, a = gap[0, i], gap[1, i] * d, gap[2, i] * d * d
        c3 = -10.0 * p - 6.0 * v - 1.5 * a
        c4 = 15.0 * p + 8.0 * v + 1.5 * a
        c5 = -6.0 * p - 3.0 * v - 0.5 * a
        out[0, i] += p + u * (v + u * (0.5 * a + u * (c3 + u * (c4 + u * c5))))
        out[1, i] += (v + u * (a + u * (3.0 * c3 + u * (4.0 * c4 + u * 5.0 * c5)))) / d
        out[2, i] += (a + u * (6.0 * c3 + u * (12.0 * c4 + u * 20.0 * c5))) / (d * d)
        if gap[3, i] != 0.0:
            w = u * (1.0 - u)
            out[0, i] += gap[3, i] * 64.0 * w * w * w
            out[1, i] += gap[3, i] * 192.0 * w * w * (1.0 - 2.0 * u) / d
            out[2, i] += gap[3, i] * 384.0 * w * (1.0 - 5.0 * w) / (d * d)

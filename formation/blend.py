"""The one way a reference changes its mind: the gap to the new course decays along a quintic, from any motion to none.

Position, velocity and acceleration stay continuous, and after `duration` the gap is exactly zero.
"""

from math import sqrt

from formation.arrays import Float
from formation.kernel import kernel

SHORTEST_S = 0.6
ACCELERATION_M_S2 = 2.5
PEAK_SPEED, PEAK_ACCELERATION = 1.875, 5.7735  # of a minimum-jerk step of unit length and duration


def duration_s(distance: float, speed: float, speed_max: float) -> float:
    """How long a gap should take to close: its peaks stay under speed_max and a gentle acceleration.

    distance, m, and speed, m/s: the gap's present size and rate.
    """
    return max(
        PEAK_SPEED * distance / speed_max,
        sqrt(PEAK_ACCELERATION * distance / ACCELERATION_M_S2),
        2.0 * speed / ACCELERATION_M_S2,
        SHORTEST_S,
    )


@kernel
def add_gap(gap: Float, elapsed_s: float, duration_s: float, out: Float) -> None:
    """Adds to the motion `out` (3, 4) what is left after elapsed_s of the gap (3, 4) it began with.

    Rows are position, velocity, acceleration. The quintic meets the gap at 0 and rest at zero at duration_s.
    """
    if elapsed_s >= duration_s:
        return
    t, d = max(elapsed_s, 0.0), duration_s
    for i in range(4):
        p, v, a = gap[0, i], gap[1, i] * d, gap[2, i] * d * d
        c3 = -10.0 * p - 6.0 * v - 1.5 * a
        c4 = 15.0 * p + 8.0 * v + 1.5 * a
        c5 = -6.0 * p - 3.0 * v - 0.5 * a
        u = t / d
        out[0, i] += p + u * (v + u * (0.5 * a + u * (c3 + u * (c4 + u * c5))))
        out[1, i] += (v + u * (a + u * (3.0 * c3 + u * (4.0 * c4 + u * 5.0 * c5)))) / d
        out[2, i] += (a + u * (6.0 * c3 + u * (12.0 * c4 + u * 20.0 * c5))) / (d * d)

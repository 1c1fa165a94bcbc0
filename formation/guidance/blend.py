"""The one way a reference changes its mind: the gap to the new course closes, from any motion to none.

Two motions add up: what motion there was is soon braked to rest, and the distance left then closes along a quintic from
rest to rest; so a long way does not let a passing motion run on. Position, velocity and acceleration stay continuous,
and after `duration` the gap is exactly zero. On the way it may make a detour: a bump that begins and ends at rest.

A gap is an array (4, 4): columns x, y, z, heading; rows position, velocity, acceleration when it began, and the
detour half-way. brake_s: how long that motion is braked.
"""

from math import sqrt

import numpy as np

from formation.maths.arrays import Float
from formation.maths.kernel import kernel

SHORTEST_S, HARDEST_S = 0.6, 0.2
ACCELERATION_M_S2 = 2.5
TURN_RAD_S = 1.0
HARD_M_S2 = 4.0  # two thirds of what a tilt of 0.6 rad gives
PEAK_BRAKING = 1.5  # of a speed braked along Hermite's cubic in unit time
STILL_M_S = 0.01
PEAK_SPEED, PEAK_ACCELERATION = 1.875, 5.7735  # of a minimum-jerk step of unit length and duration
BUMP_SPEED, BUMP_ACCELERATION = 3.4346, 24.0  # of a detour of unit height and duration


def braking_s(gap: Float) -> float:
    """How long the motion that a gap (4, 4) began with is braked where there is room."""
    speed = sqrt(gap[1, 0] ** 2 + gap[1, 1] ** 2 + gap[1, 2] ** 2)
    return max(2.0 * speed / ACCELERATION_M_S2, SHORTEST_S)


def stopping_s(gap: Float, room_m: Float) -> float:
    """How long it is braked with so much room ahead (3) in x, y, z: harder where that is short, up to HARD_M_S2."""
    speed = np.abs(gap[1, :3])
    room_s = np.min(2.0 * np.maximum(room_m, 0.0) / np.maximum(speed, STILL_M_S))
    hardest_s = PEAK_BRAKING * np.linalg.norm(speed) / HARD_M_S2
    return min(max(float(room_s), float(hardest_s), HARDEST_S), braking_s(gap))


@kernel
def braked(gap: Float, column: int, brake_s: float) -> float:
    """How far the motion of one column goes on before it is at rest."""
    ahead: float = brake_s * (0.5 * gap[1, column] + gap[2, column] * brake_s / 12.0)
    return ahead


def closing_s(gap: Float, brake_s: float, speed_max: float) -> float:
    """How long a gap (4, 4) should take to close: its peaks stay under speed_max, a gentle acceleration and turn."""
    left = [gap[0, column] + braked(gap, column, brake_s) for column in range(4)]
    distance, detour = float(np.linalg.norm(left[:3])), float(np.linalg.norm(gap[3, :3]))
    duration_s: float = max(
        (PEAK_SPEED * distance + BUMP_SPEED * detour) / speed_max,
        sqrt((PEAK_ACCELERATION * distance + BUMP_ACCELERATION * detour) / ACCELERATION_M_S2),
        PEAK_SPEED * abs(left[3]) / TURN_RAD_S,
        brake_s,
    )
    return duration_s


@kernel
def add_gap(gap: Float, brake_s: float, elapsed_s: float, duration_s: float, out: Float) -> None:
    """Adds to the motion `out` (3, 4) what is left after elapsed_s of the gap (4, 4) it began with.

    Velocity is braked along Hermite's cubic, the distance closes along the minimum-jerk quintic; the detour is
    64 u^3 (1 - u)^3 of its height.
    """
    if elapsed_s >= duration_s:
        return
    t, d = max(elapsed_s, 0.0), duration_s
    u = t / d
    b = min(t / brake_s, 1.0)
    left = (1.0 - b) * (1.0 - b)
    for i in range(4):
        ahead, v, a = braked(gap, i, brake_s), gap[1, i], gap[2, i] * brake_s
        p = gap[0, i] + ahead
        out[0, i] += p * (1.0 - u * u * u * (10.0 + u * (-15.0 + 6.0 * u)))
        out[1, i] -= p * 30.0 * u * u * (1.0 - u) * (1.0 - u) / d
        out[2, i] -= p * 60.0 * u * (1.0 - u) * (1.0 - 2.0 * u) / (d * d)
        out[0, i] += (
            brake_s * b * (v * (1.0 + b * b * (0.5 * b - 1.0)) + a * b * (0.5 + b * (0.25 * b - 2.0 / 3.0))) - ahead
        )
        out[1, i] += left * (v * (1.0 + 2.0 * b) + a * b)
        out[2, i] += (1.0 - b) * (a * (1.0 - 3.0 * b) - 6.0 * v * b) / brake_s
        if gap[3, i] != 0.0:
            w = u * (1.0 - u)
            out[0, i] += gap[3, i] * 64.0 * w * w * w
            out[1, i] += gap[3, i] * 192.0 * w * w * (1.0 - 2.0 * u) / d
            out[2, i] += gap[3, i] * 384.0 * w * (1.0 - 5.0 * w) / (d * d)

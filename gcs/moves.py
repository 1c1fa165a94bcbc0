"""A velocity that an operator asks of one drone, within what its surroundings leave of it. Pure.

It holds for HELD_NS: so long after the last one the drone is braked.
"""

from dataclasses import dataclass
from math import isfinite, sqrt

import numpy as np

from formation.config import FENCE_INSET_M, Fence
from formation.guidance.plan import Velocity
from formation.guidance.trajectory import ACCELERATION_M_S2, SHORTEST_S, TURN_RAD_S
from formation.maths.arrays import Float, Vec3, Vec3s

HELD_NS = 300_000_000


@dataclass(frozen=True, slots=True)
class Surroundings:
    """at_m (3): where the drone is led now. others_m (k, 3): bodies that do not move with it, from which it stays
    clear_m away. slots_m (s, 3): offsets in `lab` of those that do. floor_m: height of its markers on the floor.

    speed_m_s: limit of its speed, and of a slot's, by its turn too.
    """

    at_m: Vec3
    others_m: Vec3s
    clear_m: float
    slots_m: Vec3s
    fence: Fence
    floor_m: float
    speed_m_s: float


def asked_of(argument: str) -> tuple[str, Velocity] | None:
    """The body and the velocity that a request names; None for what is none."""
    body, *words = argument.rsplit(" ", 4)
    try:
        x, y, z, turn = map(float, words)
    except ValueError:
        return None
    return (body, (x, y, z, turn)) if all(map(isfinite, (x, y, z, turn))) else None


def limited(wanted: Velocity, surroundings: Surroundings) -> Velocity:
    """As much of a velocity as ends in the fence and clear of others, the slots too, if no other comes after it."""
    low_m, high_m = _volume(surroundings)
    arm_m = float(np.max(np.hypot(surroundings.slots_m[:, 0], surroundings.slots_m[:, 1]), initial=0.0))
    vel, turn = np.array(wanted[:3]), min(max(wanted[3], -TURN_RAD_S), TURN_RAD_S)
    vel *= min(1.0, surroundings.speed_m_s / max(float(np.linalg.norm(vel)), 1e-9))
    share = min(1.0, surroundings.speed_m_s / max(float(np.linalg.norm(vel)) + abs(turn) * arm_m, 1e-9))
    vel, turn = share * vel, share * turn
    if turn and arm_m > 0.0:  # wherever its slots turn to, they stay in the fence: or it does not turn
        turned_low_m, turned_high_m = np.array(surroundings.fence.low_m), np.array(surroundings.fence.high_m)
        turned_low_m[:2] += FENCE_INSET_M + arm_m
        turned_high_m[:2] -= FENCE_INSET_M + arm_m
        if (surroundings.at_m[:2] < turned_low_m[:2]).any() or (surroundings.at_m[:2] > turned_high_m[:2]).any():
            turn = 0.0
        else:
            low_m[:2], high_m[:2] = turned_low_m[:2], turned_high_m[:2]
    for away_m in surroundings.others_m - surroundings.at_m:
        distance_m = float(np.linalg.norm(away_m))
        towards = away_m / max(distance_m, 1e-9)
        vel -= max(float(vel @ towards) - _speed_within_m_s(distance_m - surroundings.clear_m), 0.0) * towards
    for k in range(3):
        least, most = (
            _speed_within_m_s(margin_m)
            for margin_m in (surroundings.at_m[k] - low_m[k], high_m[k] - surroundings.at_m[k])
        )
        vel[k] = min(max(vel[k], -least), most)
    x, y, z = np.round(vel, 3).tolist()  # a stick that trembles is no other velocity
    return x, y, z, round(turn, 3)


def _volume(surroundings: Surroundings) -> tuple[Float, Float]:
    """The corners between which it may be led, so that its slots are in the fence and nobody on the floor."""
    offsets = np.vstack((np.zeros((1, 3)), surroundings.slots_m))
    low_m = np.array(surroundings.fence.low_m) + FENCE_INSET_M
    low_m[2] = max(low_m[2], surroundings.floor_m + FENCE_INSET_M)
    return low_m - offsets.min(axis=0), np.array(surroundings.fence.high_m) - FENCE_INSET_M - offsets.max(axis=0)


def _speed_within_m_s(margin_m: float) -> float:
    """The speed that ends within that margin: it goes on for HELD_NS, a change takes SHORTEST_S, and it is braked."""
    held_s, a, margin_m = HELD_NS * 1e-9 + SHORTEST_S, ACCELERATION_M_S2, max(margin_m, 0.0)
    return 0.5 * a * (sqrt(held_s * held_s + 4.0 * margin_m / a) - held_s)

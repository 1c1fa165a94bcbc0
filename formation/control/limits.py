"""What keeps commanded vehicles inside the fence and apart: accelerations added to the law's, gently and early."""

from math import sqrt

from formation.config import PERSONAL_SPACE
from formation.estimation.state import VehicleEstimate
from formation.maths.arrays import Float
from formation.maths.kernel import kernel
from formation.maths.records import Rows

FENCE, SEPARATION = 16.0, 32.0  # bits of formation.messages.Saturation
BRAKE_M_S2 = 4.0
FENCE_RATE_1_S = 4.0
REPULSION_1_S2 = 20.0


@kernel
def keep_inside(motion: Float, low: Float, high: Float, margin_m: float, acc: Float) -> float:
    """Bounds acc (3) so that the vehicle can always stop margin_m before the fence; returns the bit if it had to.

    motion (3, 4): predicted. The speed towards a wall d metres off is held under sqrt(2 a d); past it, inwards.
    """
    bit = 0.0
    for axis in range(3):
        for side in range(2):
            sign = 1.0 if side == 1 else -1.0
            wall = high[axis] if side == 1 else -low[axis]
            room = wall - margin_m - sign * motion[0, axis]
            speed = sign * motion[1, axis]
            if room > 0.0:
                allowed = sqrt(2.0 * BRAKE_M_S2 * room)
                most = FENCE_RATE_1_S * (allowed - speed) - BRAKE_M_S2 * max(speed, 0.0) / allowed
            else:
                most = FENCE_RATE_1_S * (FENCE_RATE_1_S * room - speed)
            if sign * acc[axis] > most:
                acc[axis] = sign * most
                bit = FENCE
    return bit


@kernel
def keep_apart(me: int, estimates: Rows[VehicleEstimate], position: Float, separation_m: float, acc: Float) -> float:
    """Pushes vehicle `me`, at `position` (3), away from every other within its personal space; the bit if it did.

    The push is horizontal unless they are stacked, and grows linearly.
    """
    bit = 0.0
    space = PERSONAL_SPACE * separation_m
    for other in range(len(estimates)):
        if other == me:
            continue
        pos = estimates[other].pos_lab_m
        dx, dy, dz = position[0] - pos[0], position[1] - pos[1], position[2] - pos[2]
        distance = sqrt(dx * dx + dy * dy + dz * dz)
        if distance >= space:
            continue
        bit = SEPARATION
        push = REPULSION_1_S2 * (space - distance)
        flat = sqrt(dx * dx + dy * dy)
        if flat > 0.2 * distance and flat > 0.0:
            acc[0] += push * dx / flat
            acc[1] += push * dy / flat
        elif other < me:
            acc[0] += push
        else:
            acc[0] -= push
    return bit

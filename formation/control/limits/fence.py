"""What keeps commanded vehicles inside the fence: a bound on the demanded acceleration, gently and early."""

from math import sqrt

from formation.maths.arrays import Float
from formation.maths.kernel import kernel

FENCE = 16.0  # a bit of formation.messages.Saturation
BRAKE_M_S2 = 4.0
FENCE_RATE_1_S = 4.0


@kernel
def keep_inside(motion: Float, low: Float, high: Float, margin_m: float, lands: bool, acc: Float) -> float:
    """Bounds acc (3) so that the vehicle can always stop margin_m before the fence; returns the bit if it had to.

    motion (3, 4): predicted. The speed towards a wall d metres off is held under sqrt(2 a d); past it, inwards.
    lands: the fence's floor does not bound it, for where that lies against the room's floor nobody measures.
    """
    bit = 0.0
    for axis in range(3):
        for side in range(1 if lands and axis == 2 else 0, 2):
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

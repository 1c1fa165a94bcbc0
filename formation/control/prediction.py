"""Where a vehicle will be at a given time, from what is known now: its observers, and the commands it was sent."""

import numpy as np
from numpy.typing import NDArray

from formation.arrays import Float
from formation.kernel import kernel
from formation.response import SECONDS, answer
from formation.rigid_body import GRAVITY_M_S2


@kernel
def motion_at(
    i: int, own: int, to_ns: int, from_ns: int, pos: Float, vel: Float, dist: Float, force: Float, strength: Float,
    heading: Float, response: Float, sent_ns: NDArray[np.int64], sent: Float, out: Float, felt: Float,
) -> None:  # fmt: skip
    """Motion of vehicle i at to_ns >= from_ns into out (3, 4), and the modelled specific force then into felt (3).

    A commanded vehicle (own >= 0, its place in the history) answers its past commands by dead time and lag; Z3 and
    the acceleration of a vehicle that is only observed are taken to last.
    """
    h = (to_ns - from_ns) * SECONDS
    for axis in range(3):
        modelled, speed, travel = 0.0, 0.0, 0.0
        if own >= 0:
            dead, lag = (response[i, 0], response[i, 1]) if axis < 2 else (response[i, 2], response[i, 3])
            modelled, speed, travel = answer(sent_ns, sent[:, own, axis], from_ns, to_ns, dead, lag, force[i, axis])
        felt[axis] = modelled
        steady = dist[i, axis]
        if axis == 2 and own >= 0:
            steady -= GRAVITY_M_S2
        out[0, axis] = pos[i, axis] + h * vel[i, axis] + strength[i] * travel + 0.5 * h * h * steady
        out[1, axis] = vel[i, axis] + strength[i] * speed + h * steady
        out[2, axis] = strength[i] * modelled + steady
    out[0, 3] = heading[i, 0] + h * heading[i, 1] + 0.5 * h * h * heading[i, 2]
    out[1, 3] = heading[i, 1] + h * heading[i, 2]
    out[2, 3] = heading[i, 2]

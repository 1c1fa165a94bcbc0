"""Where a vehicle will be at a given time, from what is known now: its observers, and the commands it was sent."""

from math import exp
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from formation.estimation.update import TILT_DECAY, TURN_TRUST
from formation.maths.arrays import Float
from formation.maths.kernel import kernel
from formation.vehicle.body import GRAVITY_M_S2
from formation.vehicle.response import SECONDS, answer


@kernel
def decaying(h: float, rate_1_s: float) -> tuple[float, float, float]:
    """Single, double and triple integral over h of exp(-rate t)."""
    if rate_1_s * h < 1e-3:
        return h, 0.5 * h * h, h * h * h / 6.0
    first = (1.0 - exp(-rate_1_s * h)) / rate_1_s
    second = (h - first) / rate_1_s
    return first, second, (0.5 * h * h - second) / rate_1_s


class Known(NamedTuple):
    """The arrays of an EstimatorState, the responses and the History, as kernels pass them on."""

    t_ns: int
    pos: Float
    vel: Float
    dist: Float
    force: Float
    force_rate: Float
    strength: Float
    heading: Float
    turn: Float
    manner: Float
    response: Float
    sent_ns: NDArray[np.int64]
    sent: Float


@kernel
def motion_at(i: int | np.int64, own: int, to_ns: int, known: Known, out: Float, felt: Float) -> None:
    """Motion of vehicle i at to_ns into out (3, 4), and the modelled specific force then into felt (3).

    A commanded vehicle (own >= 0, its place in the history) answers its past commands by dead time and lag; one that
    is only observed goes on turning its force at a decaying rate. Z3 is taken to last.
    """
    h = (to_ns - known.t_ns) * SECONDS
    strength = known.strength[i]
    speed, travel = np.empty(3), np.empty(3)
    for axis in range(3):
        felt[axis] = known.force[i, axis]
    if own >= 0:
        sent, response = known.sent[:, own], known.response[i]
        for low, high in ((0, 2), (2, 3)):
            answer(
                known.sent_ns, sent[:, low:high], known.t_ns, to_ns, response[low], response[low + 1],
                felt[low:high], speed[low:high], travel[low:high],
            )  # fmt: skip
    else:
        turned, swung, swept = decaying(h, known.manner[i, TILT_DECAY])
        for axis in range(3):
            turn = known.force_rate[i, axis]
            speed[axis], travel[axis] = felt[axis] * h + turn * swung, 0.5 * felt[axis] * h * h + turn * swept
            felt[axis] += turn * turned
    for axis in range(3):
        steady = known.dist[i, axis]
        if axis == 2 and own >= 0:
            steady -= GRAVITY_M_S2
        out[0, axis] = known.pos[i, axis] + h * known.vel[i, axis] + strength * travel[axis] + 0.5 * h * h * steady
        out[1, axis] = known.vel[i, axis] + strength * speed[axis] + h * steady
        out[2, axis] = strength * felt[axis] + steady
    psi = known.heading[i]
    turning = known.turn[i] + (psi[2] if own >= 0 else known.manner[i, TURN_TRUST] * psi[2])
    out[0, 3] = psi[0] + h * psi[1] + 0.5 * h * h * turning
    out[1, 3] = psi[1] + h * turning
    out[2, 3] = turning

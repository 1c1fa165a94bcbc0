"""Where a vehicle will be at a given time, from what is known now: its observers, and the commands it was sent."""

from math import exp
from typing import NamedTuple

import numpy as np

from formation.estimation.model_mismatch import attitude_dead_s
from formation.estimation.settings import ObserverSettings
from formation.estimation.state import VehicleEstimate
from formation.maths.arrays import Float
from formation.maths.kernel import kernel
from formation.maths.records import Rows
from formation.vehicle.body import GRAVITY_M_S2
from formation.vehicle.response import SECONDS, SentCommands, answer


@kernel
def decaying(h: float, rate_1_s: float) -> tuple[float, float, float]:
    """Single, double and triple integral over h of exp(-rate t)."""
    if rate_1_s * h < 1e-3:
        return h, 0.5 * h * h, h * h * h / 6.0
    first = (1.0 - exp(-rate_1_s * h)) / rate_1_s
    second = (h - first) / rate_1_s
    return first, second, (0.5 * h * h - second) / rate_1_s


class Known(NamedTuple):
    """What predictions start from."""

    estimates: Rows[VehicleEstimate]
    observers: Rows[ObserverSettings]
    history: Rows[SentCommands]


@kernel
def motion_at(known: Known, n: int, to_ns: int, out: Float, force: Float) -> None:
    """Motion of vehicle n at to_ns into out (3, 4), and the modelled specific force then into force (3).

    A commanded vehicle answers its past commands by dead time and lag; one that is only observed goes on turning its
    force at a decaying rate. Z3 is taken to last.
    """
    z, observer = known.estimates[n], known.observers[n]
    h = (to_ns - z.t_ns) * SECONDS
    commanded = observer.place >= 0
    speed, travel = np.empty(3), np.empty(3)
    for axis in range(3):
        force[axis] = z.specific_force_lab_m_s2[axis]
    if commanded:
        sent, response = known.history[observer.place], observer.response
        answer(sent.t_ns, sent.force[:, 0:2], z.t_ns, to_ns, attitude_dead_s(z, observer), response.attitude_lag_s,
               force[0:2], speed[0:2], travel[0:2])  # fmt: skip
        answer(sent.t_ns, sent.force[:, 2:3], z.t_ns, to_ns, response.thrust_dead_s, response.thrust_lag_s,
               force[2:3], speed[2:3], travel[2:3])  # fmt: skip
    else:
        turned, swung, swept = decaying(h, observer.tilt_decay_1_s)
        for axis in range(3):
            turn = z.force_rate_lab_m_s3[axis]
            speed[axis], travel[axis] = force[axis] * h + turn * swung, 0.5 * force[axis] * h * h + turn * swept
            force[axis] += turn * turned
    scale = z.thrust_scale
    for axis in range(3):
        steady = z.dist_lab_m_s2[axis]
        if axis == 2 and commanded:
            steady -= GRAVITY_M_S2
        out[0, axis] = z.pos_lab_m[axis] + h * z.vel_lab_m_s[axis] + scale * travel[axis] + 0.5 * h * h * steady
        out[1, axis] = z.vel_lab_m_s[axis] + scale * speed[axis] + h * steady
        out[2, axis] = scale * force[axis] + steady
    turning = z.motion[2, 3]
    out[0, 3] = z.yaw_rad + h * z.yaw_rate_rad_s + 0.5 * h * h * turning
    out[1, 3] = z.yaw_rate_rad_s + h * turning
    out[2, 3] = turning

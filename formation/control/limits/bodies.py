"""Every body as the barriers see it: where it will be when a command sent now takes hold, or where it may be.

A body that is not seen is somewhere about where it was: around its last place, drifting with what is left of its last
velocity, a keep-out grows by what it can do, at any height, until it is seen again.
"""

from dataclasses import dataclass
from math import exp
from typing import NamedTuple

import numpy as np

from formation.control.composite_law import Demand
from formation.estimation.model_mismatch import MISMATCH_BAD, MISMATCH_TOLD
from formation.estimation.state import VehicleEstimate
from formation.guidance.reference_generator import VehicleReference
from formation.maths.arrays import Bool, Float
from formation.maths.kernel import kernel
from formation.maths.records import Rows
from formation.vehicle.response import NEVER_NS, SECONDS

UNSEEN_S = 0.1  # until then where it is predicted to be is where it is
DRIFT_S = 0.5  # how soon its last velocity is gone: a drone's agent levels and holds at 0.1 s, who carries one stops
ABLE_M_S2 = 4.0
HEAVES_M_S2 = 4.0  # no wind, no battery and no propeller does this to one that is given the thrust it is asked for
GROWN_MOST_M = 0.3  # a drone without setpoints is at rest within this


@dataclass(frozen=True, slots=True)
class BarrierSettings:
    """What is kept with one of the n bodies; a record.

    place: among the commanded vehicles, or -1; dead_s: dead time of attitudes; sideways_m_s2: what the tilt limit
    gives; keep_apart, keep_out, keep_slow: which barriers there are.
    """

    place: int
    dead_s: float
    separation_m: float
    speed_max_m_s: float
    sideways_m_s2: float
    keep_apart: bool
    keep_out: bool
    keep_slow: bool


class Bodies(NamedTuple):
    """All n bodies; arrays, for every pair looks at them.

    motion (n, 3, 3): position, velocity and acceleration (rows), as demanded and as disturbed; acc_m_s2 (n, 3): the
    acceleration it has; grown_m: how far beyond it each may be; known: ever seen; yields: its demand may be altered;
    answers: to its commands, as far as is known; deaf: plainly does not; lost: unseen, at a height that nobody knows.
    """

    motion: Float
    acc_m_s2: Float
    grown_m: Float
    known: Bool
    yields: Bool
    answers: Bool
    deaf: Bool
    lost: Bool


@kernel
def placed(
    settings: Rows[BarrierSettings], estimates: Rows[VehicleEstimate], wanted: Rows[Demand],
    references: Rows[VehicleReference], now_ns: int,
) -> Bodies:  # fmt: skip
    """Where all bodies are to be reckoned with."""
    count = len(settings)
    motion, acc_m_s2, grown_m = np.zeros((count, 3, 3)), np.zeros((count, 3)), np.zeros(count)
    known, yields, answers, deaf, lost = np.zeros((5, count), np.bool_)
    for n in range(count):
        s, z = settings[n], estimates[n]
        unseen_s = (z.t_ns - z.seen_ns) * SECONDS
        known[n] = z.seen_ns > NEVER_NS
        lost[n] = s.keep_out and unseen_s > UNSEEN_S
        yields[n] = s.place >= 0 and not lost[n] and references[s.place].airborne
        deaf[n] = abs(z.dist_lab_m_s2[2]) > HEAVES_M_S2 or z.model_mismatch > MISMATCH_BAD
        answers[n] = z.model_mismatch < MISMATCH_TOLD and not deaf[n]
        for axis in range(3):
            acc_m_s2[n, axis] = min(max(z.motion[2, axis], -ABLE_M_S2), ABLE_M_S2)
        if lost[n]:
            kept = exp(-unseen_s / DRIFT_S)
            grown_m[n] = min(0.5 * ABLE_M_S2 * unseen_s * unseen_s, GROWN_MOST_M)
            for axis in range(3):
                speed = z.seen_vel_lab_m_s[axis]
                motion[n, 0, axis] = z.seen_pos_lab_m[axis] + DRIFT_S * (1.0 - kept) * speed
                motion[n, 1, axis] = kept * speed
        elif yields[n]:
            demand = wanted[s.place]
            for axis in range(3):
                motion[n, 0, axis], motion[n, 1, axis] = demand.motion[0, axis], demand.motion[1, axis]
                motion[n, 2, axis] = demand.acc_lab_m_s2[axis] + z.dist_lab_m_s2[axis]
        else:
            ahead_s = (now_ns - z.t_ns) * SECONDS + s.dead_s
            for axis in range(3):
                motion[n, 0, axis] = z.motion[0, axis] + ahead_s * z.motion[1, axis]
                motion[n, 1, axis] = z.motion[1, axis]
                motion[n, 2, axis] = acc_m_s2[n, axis]  # a guess: nobody asked for it
    return Bodies(motion, acc_m_s2, grown_m, known, yields, answers, deaf, lost)

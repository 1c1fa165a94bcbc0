"""Every body as the barriers see it: where it will be when a command sent now takes hold, or where it may be.

A body that is not seen is somewhere about where it was: around its last place, drifting with what is left of its last
velocity, a keep-out grows by what it can do, at any height, until it is seen again.
"""

from dataclasses import dataclass
from math import exp

from formation.control.composite_law import Demand
from formation.estimation.state import VehicleEstimate
from formation.guidance.reference_generator import VehicleReference
from formation.maths.arrays import Vec3
from formation.maths.kernel import kernel
from formation.maths.records import Rows, dtype_of
from formation.vehicle.response import NEVER_NS, SECONDS

UNSEEN_S = 0.1  # until then where it is predicted to be is where it is
DRIFT_S = 0.5  # how soon its last velocity is gone: a drone's agent levels and holds at 0.1 s, who carries one stops
ABLE_M_S2 = 4.0
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


@dataclass(slots=True)
class Body:
    """One body; a record.

    acc: as demanded, and as disturbed; grown: how far beyond it may be; known: ever seen; yields: its demand may be
    altered; lost: unseen, at a height that nobody knows.
    """

    pos_lab_m: Vec3
    vel_lab_m_s: Vec3
    acc_lab_m_s2: Vec3
    grown_m: float
    known: bool
    yields: bool
    lost: bool


BODY = dtype_of(Body)


@kernel
def place(
    s: BarrierSettings, z: VehicleEstimate, wanted: Rows[Demand], references: Rows[VehicleReference], now_ns: int,
    out: Body,
) -> None:  # fmt: skip
    """Where a body is to be reckoned with."""
    unseen_s = (z.t_ns - z.seen_ns) * SECONDS
    out.known = z.seen_ns > NEVER_NS
    out.lost = s.keep_out and unseen_s > UNSEEN_S
    out.yields = s.place >= 0 and not out.lost and references[s.place].airborne
    out.grown_m = 0.0
    if out.lost:
        kept = exp(-unseen_s / DRIFT_S)
        out.grown_m = min(0.5 * ABLE_M_S2 * unseen_s * unseen_s, GROWN_MOST_M)
        for axis in range(3):
            speed = z.seen_vel_lab_m_s[axis]
            out.pos_lab_m[axis] = z.seen_pos_lab_m[axis] + DRIFT_S * (1.0 - kept) * speed
            out.vel_lab_m_s[axis], out.acc_lab_m_s2[axis] = kept * speed, 0.0
    elif out.yields:
        demand = wanted[s.place]
        for axis in range(3):
            out.pos_lab_m[axis], out.vel_lab_m_s[axis] = demand.motion[0, axis], demand.motion[1, axis]
            out.acc_lab_m_s2[axis] = demand.acc_lab_m_s2[axis] + z.dist_lab_m_s2[axis]
    else:
        ahead_s = (now_ns - z.t_ns) * SECONDS + s.dead_s
        for axis in range(3):
            out.vel_lab_m_s[axis] = z.motion[1, axis]
            out.pos_lab_m[axis] = z.motion[0, axis] + ahead_s * z.motion[1, axis]
            out.acc_lab_m_s2[axis] = min(max(z.motion[2, axis], -ABLE_M_S2), ABLE_M_S2)  # a guess: nobody asked for it

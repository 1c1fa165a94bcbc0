"""The leader as it is followed: as it is estimated, unless that moves as no leader may.

Slots are fixed in the leader's frame, so a step of its pose, or a turn of it that is none, would be asked of every
follower at once. Where the estimate steps, or carries a slot faster than the speed limit, followers are led on from
where they were led: the leader that they follow is then another, which approaches the estimate gently and, once there,
is the estimate again.
"""

from dataclasses import dataclass
from math import hypot, sqrt
from typing import NamedTuple

import numpy as np

from formation.guidance.blend import ACCELERATION_M_S2
from formation.guidance.reference_generator import SLOT, VehicleReference
from formation.maths.arrays import Float, Motion
from formation.maths.kernel import kernel
from formation.maths.records import Rows, blank, like
from formation.vehicle.response import SECONDS

JOLT_M_S2 = 150.0  # of a slot: beyond what noise and small turns of a real recording make of an estimate
SAME_M, SAME_M_S = 0.01, 0.1  # of a slot: so near the estimate it is the estimate again
STEP_MAX_S = 0.1


@dataclass(slots=True)
class FollowedLeader:
    """The leader as it is followed at t_ns; a record.

    shift: what is added to the estimated motion to make it this one; apart: whether it is another than the estimate.
    """

    t_ns: int
    motion: Motion
    shift: Motion
    apart: bool


class Led(NamedTuple):
    """Where vehicles are led: references (m), numbers and knots of the leader's trajectory, the leader as followed."""

    references: Rows[VehicleReference]
    numbers: Float
    knots: Float
    leader: Rows[FollowedLeader]


def as_estimated(lead: Motion, t_ns: int) -> Rows[FollowedLeader]:
    """The leader (3, 4) as it is estimated, one record."""
    made = blank(FollowedLeader, 1)
    made["t_ns"], made["motion"] = t_ns, lead
    return made


def follow(
    old: Rows[FollowedLeader], lead: Motion, t_ns: int, vehicles: Rows[VehicleReference], limits: tuple[float, float]
) -> Rows[FollowedLeader]:
    """The leader to be followed at t_ns, when it is estimated to move as `lead` (3, 4).

    vehicles (m): what is led in its slots; limits: speed of a slot, and the speed at which a step is made up for, m/s.
    """
    new = like(old)
    _follow(old, lead, t_ns, vehicles, limits[0], limits[1], new)
    return new


@kernel
def shifted(followed: Rows[FollowedLeader], at_ns: int, motion: Float) -> None:
    """Makes of the estimated leader's motion (3, 4) at a later time that of the followed one, in place."""
    leader = followed[0]
    if leader.apart:
        h = (at_ns - leader.t_ns) * SECONDS
        for column in range(4):
            p, v, a = leader.shift[0, column], leader.shift[1, column], leader.shift[2, column]
            motion[0, column] += p + h * (v + 0.5 * h * a)
            motion[1, column] += v + h * a
            motion[2, column] += a


@kernel
def longest_arm(vehicles: Rows[VehicleReference]) -> float:
    """How far the farthest slot is from the leader, m; negative where nobody is led in one."""
    arm = -1.0
    for i in range(len(vehicles)):
        if vehicles[i].kind == SLOT:
            arm = max(arm, hypot(vehicles[i].target[0], vehicles[i].target[1]))
    return arm


@kernel
def _follow(
    old: Rows[FollowedLeader], lead: Float, t_ns: int, vehicles: Rows[VehicleReference], speed_m_s: float,
    closing_m_s: float, new: Rows[FollowedLeader],
) -> None:  # fmt: skip
    """See `follow`."""
    before, now, arm = old[0], new[0], longest_arm(vehicles)
    dt_s = min((t_ns - before.t_ns) * SECONDS, STEP_MAX_S)
    now.t_ns, now.apart = t_ns, arm >= 0.0 and _parts(before, lead, dt_s, arm, speed_m_s)
    if now.apart:
        _approach(before.motion, lead, dt_s, arm, speed_m_s, closing_m_s, now.motion)
    for order in range(3):
        for column in range(4):
            if not now.apart:
                now.motion[order, column] = lead[order, column]
            now.shift[order, column] = now.motion[order, column] - lead[order, column]


@kernel
def _parts(before: FollowedLeader, lead: Float, dt_s: float, arm: float, speed_m_s: float) -> bool:
    """Whether the estimate cannot be followed: a slot on it would be too fast, or jolted, or is still elsewhere."""
    was = before.motion
    if _of_slot(lead[1], arm) > speed_m_s:
        return True
    step, jolt = np.empty(4), np.empty(4)
    for column in range(4):
        step[column], jolt[column] = lead[0, column] - was[0, column], lead[1, column] - was[1, column]
    if before.apart:
        return _of_slot(step, arm) > SAME_M or _of_slot(jolt, arm) > SAME_M_S
    return _of_slot(step, arm) > speed_m_s * dt_s + SAME_M or _of_slot(jolt, arm) > JOLT_M_S2 * dt_s


@kernel
def _of_slot(x: Float, arm: float) -> float:
    """The most that a slot so far out has of a motion's x, y, z, heading (4)."""
    most: float = sqrt(x[0] * x[0] + x[1] * x[1] + x[2] * x[2]) + abs(x[3]) * arm
    return most


@kernel
def _approach(
    was: Float, lead: Float, dt_s: float, arm: float, speed_m_s: float, closing_m_s: float, out: Float
) -> None:
    """One step (3, 4) from the motion `was` towards the leader's, within speed and acceleration."""
    acc = ACCELERATION_M_S2
    gap, wanted = np.empty(4), np.empty(4)
    for column in range(4):
        gap[column] = lead[0, column] - was[0, column]
    share = _of_slot(gap, arm)
    if share > 0.0:
        share = min(closing_m_s, sqrt(acc * share)) / share
    room = max(speed_m_s - closing_m_s, 0.0)
    carried = min(1.0, room / max(_of_slot(lead[1], arm), 1e-9))
    for column in range(4):
        wanted[column] = carried * lead[1, column] + share * gap[column] - was[1, column]
    share = min(1.0, acc * dt_s / max(_of_slot(wanted, arm), 1e-9))
    for column in range(4):
        change = share * wanted[column]
        out[0, column] = was[0, column] + dt_s * (was[1, column] + 0.5 * change)
        out[1, column] = was[1, column] + change
        out[2, column] = change / dt_s if dt_s > 0.0 else 0.0

"""The leader as it is followed: as it is estimated, unless that moves as no leader may.

Slots are fixed in the leader's frame, so a step of its pose, or a turn of it that is none, would be asked of every
follower at once. Where the estimate steps, or carries a slot faster than the speed limit, followers are led on from
where they were led: the leader that they follow is then another, which approaches the estimate gently and, once there,
is the estimate again. So it is before anybody is in a slot: the motion with which a slot is joined is against this
leader's, and that of an estimate full of noise would lead a follower away at the speed of its slot.
"""

from dataclasses import dataclass
from math import hypot, sqrt

import numpy as np

from formation.estimation.response import SECONDS
from formation.guidance.shape import Shape
from formation.guidance.trajectory import ACCELERATION_M_S2
from formation.maths.arrays import Float, Motion, Vec4
from formation.maths.kernel import kernel
from formation.maths.records import Rows, blank, like

SLOT_ACC_MAX_M_S2 = 150.0  # of a slot: beyond what noise and small turns of a real recording make of an estimate
SAME_M, SAME_M_S = 0.01, 0.1  # of a slot: so near the estimate it is the estimate again
STEP_MAX_S = 0.1
MEAN_S = 0.3
"""Over so long the velocity is averaged with which another leader goes along: noise of one is no motion."""


@dataclass(slots=True)
class FollowedLeader:
    """The leader as it is followed at t_ns; a record.

    shift: the difference of this motion from the estimated one; is_shifted: whether there is one.
    mean_vel: recent mean of the estimated velocity, limited to a slot's speed; larger velocities count less.
    """

    t_ns: int
    motion: Motion
    shift: Motion
    is_shifted: bool
    mean_vel: Vec4


def as_estimated(lead: Motion, t_ns: int) -> Rows[FollowedLeader]:
    """The leader (3, 4) as it is estimated, one record."""
    made = blank(FollowedLeader, 1)
    made["t_ns"], made["motion"], made["mean_vel"] = t_ns, lead, lead[1]
    return made


def slots_arm_m(shape: Shape) -> float:
    """How far the farthest slot is from the leader's vertical axis, about which they turn."""
    return max((hypot(x, y) for x, y, _ in shape.offset_lead_m), default=0.0)


def follow(
    old: Rows[FollowedLeader], lead: Motion, t_ns: int, arm_m: float, limits: tuple[float, float]
) -> Rows[FollowedLeader]:
    """The leader to be followed at t_ns, when it is estimated to move as `lead` (3, 4).

    arm_m: how far the farthest slot is from it, negative where nobody is to follow; limits: speed of a slot, and the
    speed at which a step is made up for, m/s.
    """
    new = like(old)
    _follow(old, lead, t_ns, arm_m, limits[0], limits[1], new)
    return new


@kernel
def shifted(followed: Rows[FollowedLeader], at_ns: int, motion: Float) -> None:
    """Makes of the estimated leader's motion (3, 4) at a later time that of the followed one, in place."""
    leader = followed[0]
    if leader.is_shifted:
        h = (at_ns - leader.t_ns) * SECONDS
        for column in range(4):
            p, v, a = leader.shift[0, column], leader.shift[1, column], leader.shift[2, column]
            motion[0, column] += p + h * (v + 0.5 * h * a)
            motion[1, column] += v + h * a
            motion[2, column] += a


@kernel
def _follow(
    old: Rows[FollowedLeader], lead: Float, t_ns: int, arm: float, speed_m_s: float, closing_m_s: float,
    new: Rows[FollowedLeader],
) -> None:  # fmt: skip
    """See `follow`."""
    before, now = old[0], new[0]
    dt_s = min((t_ns - before.t_ns) * SECONDS, STEP_MAX_S)
    scale = min(1.0, speed_m_s / max(_of_slot(lead[1], arm), 1e-9))
    share = scale * scale * dt_s / (dt_s + MEAN_S)
    for column in range(4):
        mean = before.mean_vel[column]
        now.mean_vel[column] = mean + share * (scale * lead[1, column] - mean)
    now.t_ns, now.is_shifted = t_ns, arm >= 0.0 and _parts(before, lead, dt_s, arm, speed_m_s)
    if now.is_shifted:
        _approach(before.motion, lead[0], now.mean_vel, dt_s, arm, speed_m_s, closing_m_s, now.motion)
    for order in range(3):
        for column in range(4):
            if not now.is_shifted:
                now.motion[order, column] = lead[order, column]
            now.shift[order, column] = now.motion[order, column] - lead[order, column]


@kernel
def _parts(before: FollowedLeader, lead: Float, dt_s: float, arm: float, speed_m_s: float) -> bool:
    """Whether the estimate cannot be followed: a slot on it would be too fast, or jolted, or is still elsewhere."""
    was = before.motion
    if _of_slot(lead[1], arm) > speed_m_s:
        return True
    step, vel_step = np.empty(4), np.empty(4)
    for column in range(4):
        step[column], vel_step[column] = lead[0, column] - was[0, column], lead[1, column] - was[1, column]
    if before.is_shifted:
        return _of_slot(step, arm) > SAME_M or _of_slot(vel_step, arm) > SAME_M_S
    return _of_slot(step, arm) > speed_m_s * dt_s + SAME_M or _of_slot(vel_step, arm) > SLOT_ACC_MAX_M_S2 * dt_s


@kernel
def _of_slot(x: Float, arm: float) -> float:
    """The most that a slot so far out has of a motion's x, y, z, heading (4)."""
    most: float = sqrt(x[0] * x[0] + x[1] * x[1] + x[2] * x[2]) + abs(x[3]) * arm
    return most


@kernel
def _approach(
    was: Float, there: Float, vel: Float, dt_s: float, arm: float, speed_m_s: float, closing_m_s: float, out: Float
) -> None:  # fmt: skip
    """One step (3, 4) from the motion `was` to the leader's place, at its velocity, within speed and acceleration."""
    acc = ACCELERATION_M_S2
    gap, wanted = np.empty(4), np.empty(4)
    for column in range(4):
        gap[column] = there[column] - was[0, column]
    share = _of_slot(gap, arm)
    if share > 0.0:
        share = min(closing_m_s, sqrt(acc * share)) / share
    spare_m_s = max(speed_m_s - closing_m_s, 0.0)
    carried = min(1.0, spare_m_s / max(_of_slot(vel, arm), 1e-9))
    for column in range(4):
        wanted[column] = carried * vel[column] + share * gap[column] - was[1, column]
    share = min(1.0, acc * dt_s / max(_of_slot(wanted, arm), 1e-9))
    for column in range(4):
        change = share * wanted[column]
        out[0, column] = was[0, column] + dt_s * (was[1, column] + 0.5 * change)
        out[1, column] = was[1, column] + change
        out[2, column] = change / dt_s if dt_s > 0.0 else 0.0

"""Where a vehicle, the leader and a reference will be when a command sent now takes hold, from what is known now.

What is known: the observers, the commands that were sent, and the course that vehicles are led along.
"""

from dataclasses import dataclass
from math import exp
from typing import Annotated, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from formation.estimation.response import SECONDS, SentCommands, answer, attitude_dead_s
from formation.estimation.settings import ObserverSettings
from formation.estimation.state import VehicleEstimate
from formation.guidance.followed_leader import FollowedLeader, shifted
from formation.guidance.reference_generator import VehicleReference, reference_at
from formation.maths.arrays import Float, Layout, Motion, Vec3
from formation.maths.kernel import kernel
from formation.maths.records import Rows, dtype_of
from formation.paper.eq2_relative_frame import copy_motion, lead_from_lab
from formation.vehicle.body import GRAVITY_M_S2

LEADER = cast(int, np.int64(0))  # a literal 0 would be a type of its own, and the prediction compiled once more


class LawContext(NamedTuple):
    """What demands are computed from, besides each vehicle's own settings.

    estimates, observers (n); history: commands sent to the m commanded; references (m), numbers and knots of the
    leader's trajectory, leader: as it is followed (1).
    """

    estimates: Rows[VehicleEstimate]
    observers: Rows[ObserverSettings]
    history: Rows[SentCommands]
    references: Rows[VehicleReference]
    numbers: Float
    knots: Float
    leader: Rows[FollowedLeader]


@dataclass(slots=True)
class Workspace:
    """Motions (3, 4) and vectors (3) of one vehicle's turn in one channel, reused for the next; a record.

    leader, leader_later, leader_earlier: the leader as predicted last, when the command holds and half the window later
    and earlier, and leader_ns for when and which: vehicles of one kind ask for the same. lab, lab_change: the reference
    when the command holds, and what it changes by in the window about then; lab_bend: how much more in the later half
    than in the earlier, 0 of what follows an observed leader, for nobody knows it. heading: the leader's, its rate
    and acceleration, as planned where that is known, else no acceleration: its slots turn with the leader as it is
    seen, but nobody's own heading has to.
    """

    leader_ns: Annotated[NDArray[np.int64], Layout(np.int64, (2,))]
    leader: Motion
    leader_later: Motion
    leader_earlier: Motion
    mine: Motion
    lead: Motion
    lead_other: Motion
    error: Motion
    slot: Motion
    frame: Motion
    lab: Motion
    lab_other: Motion
    lab_change: Motion
    lab_bend: Motion
    heading: Vec3
    force: Vec3
    feedback: Vec3
    feedback_rate: Vec3


WORKSPACE = dtype_of(Workspace)


@kernel
def situation(i: int, n: int, context: LawContext, hold_ns: int, half_ns: int, w: Workspace) -> None:
    """Vehicle i's own motion, reference and error at hold_ns, and its reference's change about then, into w.

    half_ns: of the window of that change; 0 where nobody asks for it.
    """
    numbers, knots, reference = context.numbers, context.knots, context.references[i]
    _leader_ahead(context, hold_ns, half_ns, w)
    if half_ns > 0:
        copy_motion(w.leader_later, w.lead_other)
        reference_at(reference, numbers, knots, hold_ns + half_ns, w.lead_other, w.slot, w.frame, w.lab_change)
        copy_motion(w.leader_earlier, w.lead_other)
        reference_at(reference, numbers, knots, hold_ns - half_ns, w.lead_other, w.slot, w.frame, w.lab_other)
        for order in range(3):
            for column in range(4):
                w.lab_change[order, column] -= w.lab_other[order, column]
    motion_at(context, n, hold_ns, w.mine, w.force)
    reference_at(reference, numbers, knots, hold_ns, w.lead, w.slot, w.frame, w.lab)
    planned = half_ns > 0 and context.observers[LEADER].commanded_index >= 0
    for order in range(3):
        for column in range(4):
            bend = w.lab_change[order, column] + 2.0 * (w.lab_other[order, column] - w.lab[order, column])
            w.lab_bend[order, column] = bend if planned else 0.0
    lead_from_lab(w.mine, w.frame, w.error)
    for order in range(3):
        for column in range(4):
            w.error[order, column] -= w.slot[order, column]


@kernel
def _leader_ahead(context: LawContext, hold_ns: int, half_ns: int, w: Workspace) -> None:
    """The leader's motion at hold_ns, and half_ns later and earlier if that is wanted, into the workspace.

    A leader we command is taken to accelerate and turn as its own reference says: known ahead, and free of noise.
    """
    if w.leader_ns[0] != hold_ns or w.leader_ns[1] != half_ns:
        w.leader_ns[0], w.leader_ns[1] = hold_ns, half_ns
        motion_at(context, LEADER, hold_ns, w.leader, w.force)
        shifted(context.leader, hold_ns, w.leader)
        w.heading[0], w.heading[1], w.heading[2] = w.leader[0, 3], w.leader[1, 3], 0.0
        commanded_index = context.observers[LEADER].commanded_index
        if half_ns > 0 and commanded_index < 0:
            for at_ns, out in ((hold_ns + half_ns, w.leader_later), (hold_ns - half_ns, w.leader_earlier)):
                motion_at(context, LEADER, at_ns, out, w.force)
                shifted(context.leader, at_ns, out)
        elif half_ns > 0:
            _as_referred(context.references[commanded_index], context, hold_ns, half_ns, w)
    copy_motion(w.leader, w.lead)


@kernel
def _as_referred(reference: VehicleReference, context: LawContext, hold_ns: int, half_ns: int, w: Workspace) -> None:
    """A commanded leader's motion later and earlier: from `leader` on as its reference goes, and all accelerations."""
    numbers, knots, now = context.numbers, context.knots, w.leader
    reference_at(reference, numbers, knots, hold_ns, now, w.slot, w.frame, w.lab)
    for order in range(3):
        w.heading[order] = w.lab[order, 3]
    for at_ns, out in ((hold_ns + half_ns, w.leader_later), (hold_ns - half_ns, w.leader_earlier)):
        reference_at(reference, numbers, knots, at_ns, now, w.slot, w.frame, w.lab_other)
        for column in range(4):
            for order in range(2):
                out[order, column] = now[order, column] + w.lab_other[order, column] - w.lab[order, column]
            out[2, column] = w.lab_other[2, column]
    for column in range(4):
        now[2, column] = w.lab[2, column]


@kernel
def motion_at(context: LawContext, n: int, to_ns: int, out: Float, force: Float) -> None:
    """Motion of vehicle n at to_ns into out (3, 4), and the modelled specific force then into force (3).

    A commanded vehicle answers its past commands by dead time and lag; one that is only observed goes on turning its
    force at a decaying rate. Z3 is taken to last. Drag, f(x) of Eq. (4), slows a commanded vehicle: the velocity loses
    drag_1_s times the distance, by the trapezoidal rule.
    """
    z, observer = context.estimates[n], context.observers[n]
    h = (to_ns - z.t_ns) * SECONDS
    commanded = observer.commanded_index >= 0
    speed, travel = np.empty(3), np.empty(3)
    for axis in range(3):
        force[axis] = z.specific_force_lab_m_s2[axis]
    if commanded:
        sent, response = context.history[observer.commanded_index], observer.response
        answer(sent.t_ns, sent.force[:, 0:2], z.t_ns, to_ns, attitude_dead_s(z, observer), response.attitude_lag_s,
               force[0:2], speed[0:2], travel[0:2])  # fmt: skip
        answer(sent.t_ns, sent.force[:, 2:3], z.t_ns, to_ns, response.thrust_dead_s, response.thrust_lag_s,
               force[2:3], speed[2:3], travel[2:3])  # fmt: skip
    else:
        turned, swung, swept = decaying(h, observer.tilt_decay_1_s)
        for axis in range(3):
            turn = z.observed.force_rate_lab_m_s3[axis]
            speed[axis], travel[axis] = force[axis] * h + turn * swung, 0.5 * force[axis] * h * h + turn * swept
            force[axis] += turn * turned
    scale = z.thrust_scale
    for axis in range(3):
        steady = z.dist_lab_m_s2[axis]
        if axis == 2 and commanded:
            steady -= GRAVITY_M_S2
        drag = observer.drag_1_s[axis]
        free = h * z.vel_lab_m_s[axis] + scale * travel[axis] + 0.5 * h * h * steady
        moved = free / (1.0 + 0.5 * drag * h)  # the integral of the distance is about h / 2 times it
        out[0, axis] = z.pos_lab_m[axis] + moved
        out[1, axis] = z.vel_lab_m_s[axis] + scale * speed[axis] + h * steady - drag * moved
        out[2, axis] = scale * force[axis] + steady - drag * out[1, axis]
    turning = z.motion[2, 3]
    out[0, 3] = z.heading.yaw_rad + h * z.heading.rate_rad_s + 0.5 * h * h * turning
    out[1, 3] = z.heading.rate_rad_s + h * turning
    out[2, 3] = turning


@kernel
def decaying(h: float, rate_1_s: float) -> tuple[float, float, float]:
    """Single, double and triple integral over h of exp(-rate t)."""
    if rate_1_s * h < 1e-3:
        return h, 0.5 * h * h, h * h * h / 6.0
    first = (1.0 - exp(-rate_1_s * h)) / rate_1_s
    second = (h - first) / rate_1_s
    return first, second, (0.5 * h * h - second) / rate_1_s

"""The formation law for all vehicles: from estimates, references and past commands to demanded accelerations (Eq. 7).

Each axis is judged at the time when a command sent now takes hold: own and leader's motions are predicted over the
dead time with the commands already sent, and the first-order lag is inverted with the demand's own rate.

`feedback` is the one place where a law is chosen: error in, feedback acceleration out, for one axis of one vehicle.
"""

from dataclasses import dataclass
from math import cos, sin, sqrt

import numpy as np

from formation.control.gains import AxisGains, CascadeGains, GeometricGains, LagCompensation, Law, SlidingGains
from formation.control.geometric import tracking_acceleration
from formation.control.pid import velocity_error, velocity_pid
from formation.control.prediction import (
    LEADER,
    WORKSPACE,
    LawContext,
    Workspace,
    motion_at,
    situation,
)
from formation.estimation.downwash import downwash_m_s2, jets
from formation.estimation.response import NEVER_NS, SECONDS, attitude_dead_s
from formation.guidance.followed_leader import STEP_MAX_S
from formation.guidance.reference_generator import SLOT
from formation.maths.arrays import Float, Motion, Vec3
from formation.maths.kernel import kernel
from formation.maths.records import Rows, blank
from formation.paper.eq2_relative_frame import copy_motion
from formation.paper.eq7_composite_law import composite_acceleration
from formation.paper.eq56_super_twisting import (
    equivalent_and_reaching,
    sliding_variable,
    super_twisting,
    super_twisting_rate,
    switching,
)

HORIZON_MAX_NS = 400_000_000
HORIZONTAL, VERTICAL = range(2)  # the channels, each with a workspace of its own
SMC, CFC, PID, GEOMETRIC = int(Law.SMC), int(Law.CFC), int(Law.PID), int(Law.GEOMETRIC)
SIDEWAYS_MOST_M_S2 = 11.7  # of gravity at a tilt of 50 degrees, the most that an agent follows
Feedback = tuple[float, float, float, float, float]
"""s, t_m, the law's new memory (z_m or integral), the feedback acceleration, and that acceleration's rate."""


@dataclass(frozen=True, slots=True)
class LawSettings:
    """One commanded vehicle's law; a record.

    vehicle: its index among the n; compensate: whether the attitude's dead time and lag are (the thrust's always).
    """

    vehicle: int
    horizontal: AxisGains
    vertical: AxisGains
    compensate: bool
    lag_compensation: LagCompensation
    speed_m_s: float


@dataclass(slots=True)
class LawMemory:
    """What the law remembers of one vehicle from tick to tick; a record.

    z_m: of Eq. (6), or a PID's integral; asked_ns: when; saturated: the last target met a limit, so z_m may not grow.
    """

    z_m: Vec3
    asked_ns: int
    saturated: bool


def no_memory(vehicles: int) -> Rows[LawMemory]:
    """Before the law was first asked."""
    memory = blank(LawMemory, vehicles)
    memory["asked_ns"] = NEVER_NS
    return memory


@dataclass(slots=True)
class Demand:
    """What the law asks of one vehicle, and the inside of how it got there; a record.

    e, e_rate, s, t_m, z_m: in the lead frame, Eqs. (5)-(6); acc: demanded acceleration, gravity excluded; lead_acc:
    what the lag's inversion adds to it; acc_rate, snap: of the reference and of drag on it; motion: predicted when the
    command is taken to hold; specific_force: modelled when it arrives; tilt_cos: predicted cosine of tilt when the
    thrust does; yaw, yaw_rate, yaw_acc: of the heading asked for; limits_met: bits of formation.messages.Saturation for
    what has altered it since.
    """

    e_lead_m: Vec3
    e_rate_lead_m_s: Vec3
    s_lead_m_s: Vec3
    t_m_lead_m_s2: Vec3
    z_m_lead_m_s2: Vec3
    acc_lab_m_s2: Vec3
    lead_acc_lab_m_s2: Vec3
    acc_rate_lab_m_s3: Vec3
    snap_lab_m_s4: Vec3
    motion: Motion
    specific_force_lab_m_s2: Vec3
    tilt_cos: float
    yaw_rad: float
    yaw_rate_rad_s: float
    yaw_acc_rad_s2: float
    limits_met: float


def demand(settings: Rows[LawSettings], context: LawContext, memory: Rows[LawMemory], now_ns: int) -> Rows[Demand]:
    """The law at now_ns for the m commanded vehicles among the n."""
    out = blank(Demand, len(settings))
    _demand(settings, context, memory, now_ns, out)
    return out


@kernel
def _demand(
    settings: Rows[LawSettings], context: LawContext, memory: Rows[LawMemory], now_ns: int, out: Rows[Demand]
) -> None:
    """See `demand`; out (m) is filled."""
    # A record keeps no array alive that it lies in: `space` has to be there as long as anybody writes into it.
    space = np.empty(2, WORKSPACE)
    for channel in range(2):
        space[channel].leader_ns[:] = NEVER_NS
    for i in range(len(settings)):
        _vehicle_demand(i, settings[i], context, memory[i], now_ns, space, out[i])


@kernel
def _vehicle_demand(
    i: int, law: LawSettings, context: LawContext, memory: LawMemory, now_ns: int, space: Rows[Workspace], out: Demand
) -> None:
    """One vehicle's turn."""
    dt_s = 0.0
    if memory.asked_ns > NEVER_NS:
        dt_s = min((now_ns - memory.asked_ns) * SECONDS, STEP_MAX_S)
    at_ns = min(now_ns, context.estimates[law.vehicle].t_ns + HORIZON_MAX_NS)
    _horizontal_demand(i, law, context, memory, at_ns, dt_s, space[HORIZONTAL], out)
    _vertical_demand(i, law, context, memory, at_ns, dt_s, space[VERTICAL], out)


@kernel
def _horizontal_demand(
    i: int,
    law: LawSettings,
    context: LawContext,
    memory: LawMemory,
    now_ns: int,
    dt_s: float,
    w: Workspace,
    out: Demand,
) -> None:
    """x and y, by attitude."""
    n = law.vehicle
    lag_s = context.observers[n].response.attitude_lag_s
    arrival_ns = now_ns + int(attitude_dead_s(context.estimates[n], context.observers[n]) * 1e9)
    hold_ns = arrival_ns if law.compensate else context.estimates[n].t_ns
    lag_ns = int(lag_s * 1e9)
    situation(i, n, context, hold_ns, lag_ns // 2 if law.compensate else 0, w)
    gain = _adaptive_gain(i, law, context)
    boost = gain**law.lag_compensation.p1_power
    for axis in range(2):
        _feed_back(
            axis,
            law.horizontal,
            law.speed_m_s,
            boost,
            memory,
            context.references[i].airborne,
            dt_s,
            w,
            out,
        )
    _add_turn_terms(w.frame, w.error, w.feedback)
    _into_lab(w.frame[0, 3], w.feedback)
    _into_lab(w.frame[0, 3], w.feedback_rate)
    copy_motion(w.mine, out.motion)
    if not law.compensate:  # its turn is bounded from the arrival's force all the same
        motion_at(context, n, arrival_ns, w.lead_other, w.force)
    for axis in range(3):
        out.specific_force_lab_m_s2[axis] = w.force[axis]
    pull = law.lag_compensation.gain * gain**law.lag_compensation.gain_power - 1.0
    for axis in range(2):
        _ask(axis, law.horizontal, context.estimates[n].dist_lab_m_s2[axis], w, out)
    bound_sideways(out.acc_lab_m_s2)
    for axis in range(2):
        if law.compensate:
            z3, drag_1_s = context.estimates[n].dist_lab_m_s2[axis], context.observers[n].drag_1_s[axis]
            _invert_lag(axis, lag_s, law.lag_compensation.rate, pull, z3, drag_1_s, w, out)


@kernel
def _vertical_demand(
    i: int,
    law: LawSettings,
    context: LawContext,
    memory: LawMemory,
    now_ns: int,
    dt_s: float,
    w: Workspace,
    out: Demand,
) -> None:
    """z, by thrust; and the heading, which a target reaches as soon (its rate is fed forward)."""
    n = law.vehicle
    dead_s, lag_s = context.observers[n].response.thrust_dead_s, context.observers[n].response.thrust_lag_s
    hold_ns = now_ns + int(dead_s * 1e9)
    situation(i, n, context, hold_ns, int(lag_s * 1e9) // 2, w)
    out.yaw_rad, out.yaw_rate_rad_s, out.yaw_acc_rad_s2 = w.lab[0, 3], w.lab[1, 3], w.lab[2, 3]
    if context.references[i].kind == SLOT:
        out.yaw_rad += w.heading[0] - w.lead[0, 3]
        out.yaw_rate_rad_s += w.heading[1] - w.lead[1, 3]
        out.yaw_acc_rad_s2 += w.heading[2] - w.lead[2, 3]
    z, z3 = context.estimates[n], context.estimates[n].dist_lab_m_s2[2]
    if z.downwash_m_s2 < 0.0:
        flying = jets(context.estimates, context.observers)
        z3 += downwash_m_s2(flying, context.observers, n, (hold_ns - z.t_ns) * SECONDS) - z.downwash_m_s2
    for axis in range(2, 3):  # as a plain 2 it would be a type of its own to numba, and compiled again
        _feed_back(axis, law.vertical, law.speed_m_s, 1.0, memory, context.references[i].airborne, dt_s, w, out)
        _ask(axis, law.vertical, z3, w, out)
        drag_1_s = context.observers[n].drag_1_s[axis]
        _invert_lag(axis, lag_s, law.lag_compensation.rate, 0.0, z3, drag_1_s, w, out)
    for order in range(3):
        out.motion[order, 2] = w.mine[order, 2]
    size = sqrt(w.force[0] * w.force[0] + w.force[1] * w.force[1] + w.force[2] * w.force[2])
    out.tilt_cos = w.force[2] / size if size > 1.0 else 1.0


@kernel
def _adaptive_gain(i: int, law: LawSettings, context: LawContext) -> float:
    """The vehicle's own, or that of the leader it follows, if that one is only observed."""
    own: float = context.estimates[law.vehicle].adaptive_gain
    if context.references[i].kind == SLOT and context.observers[LEADER].commanded_index < 0:
        guidance: float = context.estimates[LEADER].adaptive_gain ** law.lag_compensation.lead_share
        return max(own, guidance)
    return own


@kernel
def _feed_back(
    axis: int, gains: AxisGains, speed_m_s: float, boost: float, memory: LawMemory, airborne: bool, dt_s: float,
    w: Workspace, out: Demand,
) -> None:  # fmt: skip
    """Eqs. (5)-(6) of one axis: error, sliding variable, t_m and the new z_m; its feedback into the workspace."""
    e, e_rate, e_acc, before = w.error[0, axis], w.error[1, axis], w.error[2, axis], memory.z_m[axis]
    s, t_m, z_m, w.feedback[axis], w.feedback_rate[axis] = feedback(
        gains, e, e_rate, e_acc, before, boost, speed_m_s, dt_s
    )
    out.e_lead_m[axis], out.e_rate_lead_m_s[axis], out.s_lead_m_s[axis], out.t_m_lead_m_s2[axis] = e, e_rate, s, t_m
    out.z_m_lead_m_s2[axis] = before if memory.saturated and abs(z_m) > abs(before) else z_m
    if not airborne:
        out.z_m_lead_m_s2[axis] = 0.0


@kernel
def feedback(
    gains: AxisGains, e: float, e_rate: float, e_acc: float, memory: float, boost: float, speed_m_s: float, dt_s: float
) -> Feedback:
    """The feedback of an axis by its law, in the lead frame.

    e, e_rate, e_acc: relative error; boost: factor on p1. |e| is cut where closing it would ask for more than
    speed_m_s. The rate holds while errors evolve as predicted; it is what inverts the vehicle's first-order lag.
    """
    if gains.law == GEOMETRIC:
        return geometric_feedback(gains.geometric, e, e_rate, e_acc, memory, speed_m_s, dt_s)
    if gains.law == PID:
        return pid_feedback(gains.cascade, e, e_rate, e_acc, memory, speed_m_s, dt_s)
    return sliding_feedback(gains.sliding, e, e_rate, e_acc, memory, boost, speed_m_s, dt_s)


@kernel
def sliding_feedback(
    gains: SlidingGains, e: float, e_rate: float, e_acc: float, z_m: float, boost: float, speed_m_s: float, dt_s: float
) -> Feedback:
    """Eqs. (5)-(6), and of Eq. (7) -c e' - t_m; SMC: t_m = k sign(s)."""
    c, p1, p2, eps, smooth = gains.c, boost * gains.p1, gains.p2, gains.eps, gains.smooth_m_s
    e = clamp(e, speed_m_s / c)
    s = sliding_variable(c, e, e_rate)
    s_rate = sliding_variable(c, e_rate, e_acc)
    t_rate = 0.0
    if gains.law == SMC:
        t_m = switching(s, gains.k)
    else:
        t_m, z_m = super_twisting(s, z_m, p1, p2, eps, smooth, dt_s)
        if smooth > 0.0:
            t_rate = super_twisting_rate(s, s_rate, p1, p2, eps, smooth)
    return s, t_m, z_m, equivalent_and_reaching(c, e_rate, t_m), -c * e_acc - t_rate


@kernel
def pid_feedback(
    gains: CascadeGains, e: float, e_rate: float, e_acc: float, integral: float, speed_m_s: float, dt_s: float
) -> Feedback:
    """The cascade double-loop PID; its velocity error stands for s."""
    kp_position, kp, ki, kd = gains.kp_position, gains.kp, gains.ki, gains.kd
    e = clamp(e, speed_m_s / kp_position)
    s = velocity_error(kp_position, e, e_rate)
    s_rate = velocity_error(kp_position, e_rate, e_acc)
    acc, integral = velocity_pid(s, s_rate, integral, kp, ki, kd, dt_s)
    return s, -acc, integral, acc, -kp * s_rate - ki * s


@kernel
def geometric_feedback(
    gains: GeometricGains, e: float, e_rate: float, e_acc: float, integral: float, speed_m_s: float, dt_s: float
) -> Feedback:
    """The SE(3) controller's translational part; what its integral sums up stands for s."""
    kx, kv, ki, mix, bound = gains.kx, gains.kv, gains.ki, gains.mix, gains.bound
    e = clamp(e, speed_m_s * kv / kx)
    acc, integral = tracking_acceleration(e, e_rate, integral, kx, kv, ki, mix, bound, dt_s)
    s = mix * e + e_rate
    return s, -acc, integral, acc, -kx * e_rate - kv * e_acc - ki * s


@kernel
def clamp(x: float, most: float) -> float:
    """x within [-most, most]."""
    return min(max(x, -most), most)


@kernel
def _add_turn_terms(frame: Float, error: Float, acc: Float) -> None:
    """Adds the Coriolis, Euler and centripetal terms of the error itself; the slot's own are in its lab motion."""
    w, alpha = frame[1, 3], frame[2, 3]
    acc[0] += -2.0 * w * error[1, 1] - alpha * error[0, 1] - w * w * error[0, 0]
    acc[1] += 2.0 * w * error[1, 0] + alpha * error[0, 0] - w * w * error[0, 1]


@kernel
def _into_lab(heading: float, v: Float) -> None:
    """Turns a lead vector (3) into `lab`, in place."""
    c, s = cos(heading), sin(heading)
    x, y = v[0], v[1]
    v[0], v[1] = c * x - s * y, s * x + c * y


@kernel
def _ask(axis: int, gains: AxisGains, z3: float, w: Workspace, out: Demand) -> None:
    """Eq. (7) of one axis in `lab`."""
    z3_used = z3 if uses_disturbance(gains) else 0.0
    out.acc_lab_m_s2[axis] = composite_acceleration(w.lab[2, axis], w.feedback[axis], z3_used)


@kernel
def uses_disturbance(gains: AxisGains) -> bool:
    """Whether the law subtracts the observer's Z3 (CFC), or fights disturbances by its own integral."""
    return gains.law == CFC


@kernel
def bound_sideways(acc: Float) -> None:
    """Keeps a demand (3) within SIDEWAYS_MOST_M_S2 in place: the barriers that follow are designed for that."""
    size = sqrt(acc[0] * acc[0] + acc[1] * acc[1])
    if size > SIDEWAYS_MOST_M_S2:
        acc[0] *= SIDEWAYS_MOST_M_S2 / size
        acc[1] *= SIDEWAYS_MOST_M_S2 / size


@kernel
def _invert_lag(
    axis: int, lag_s: float, share: float, pull: float, z3: float, drag_1_s: float, w: Workspace,
    out: Demand,
) -> None:  # fmt: skip
    """What is added to one axis's demand to invert the lag: lag_s times the demand's rate when the command holds.

    The reference's rate is its mean over the lag about then. share: of the feedback's own rate that is sent ahead;
    pull: how much harder than needed the command pulls at what the predicted acceleration misses; drag_1_s: see
    ObserverSettings, for the drag too is needed ahead.
    """
    coming = w.lab_change[2, axis] + drag_1_s * w.lab_change[1, axis]
    bend = w.lab_bend[2, axis] + drag_1_s * w.lab_bend[1, axis]
    out.acc_rate_lab_m_s3[axis], out.snap_lab_m_s4[axis] = coming / lag_s, 4.0 * bend / (lag_s * lag_s)
    missing = out.acc_lab_m_s2[axis] - (w.mine[2, axis] - z3)
    out.lead_acc_lab_m_s2[axis] = coming + share * lag_s * w.feedback_rate[axis] + pull * missing

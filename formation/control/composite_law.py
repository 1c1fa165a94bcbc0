"""The formation law for all vehicles: from estimates, references and past commands to demanded accelerations (Eq. 7).

Each axis is judged at the time when a command sent now takes hold: own and leader's motions are predicted over the
dead time with the commands already sent, and the first-order lag is inverted with the demand's own rate.
"""

from dataclasses import dataclass
from math import cos, sin, sqrt
from typing import Annotated, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from formation.control.feedback import bound_sideways, feedback, uses_disturbance
from formation.control.gains import AxisGains, LagCompensation
from formation.control.prediction import Known, motion_at
from formation.control.relative_frame import copy_motion, lead_from_lab
from formation.estimation.model_mismatch import attitude_dead_s
from formation.estimation.settings import ObserverSettings
from formation.estimation.state import VehicleEstimate
from formation.guidance.followed_leader import Led, shifted
from formation.guidance.reference_generator import SLOT, VehicleReference, reference_at
from formation.maths.arrays import Float, Layout, Motion, Vec3
from formation.maths.kernel import kernel
from formation.maths.records import Rows, blank, dtype_of
from formation.vehicle.response import NEVER_NS, SECONDS, SentCommands

HORIZON_MAX_NS = 400_000_000
HORIZONTAL, VERTICAL = 0, 1  # the channels, each with a workspace of its own
STEP_MAX_S = 0.1
LEADER = cast(int, np.int64(0))  # a literal 0 would be a type of its own, and the prediction compiled once more


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
    speed_max_m_s: float


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
    what the lag's inversion adds to it; motion: predicted when the command is taken to hold; specific_force: modelled
    when it arrives; tilt_cos: predicted cosine of tilt when the thrust does; yaw, yaw_rate: of the heading asked for;
    limits_met: bits of formation.messages.Saturation for what has altered it since.
    """

    e_lead_m: Vec3
    e_rate_lead_m_s: Vec3
    s_lead_m_s: Vec3
    t_m_lead_m_s2: Vec3
    z_m_lead_m_s2: Vec3
    acc_lab_m_s2: Vec3
    lead_acc_lab_m_s2: Vec3
    motion: Motion
    specific_force_lab_m_s2: Vec3
    tilt_cos: float
    yaw_rad: float
    yaw_rate_rad_s: float
    limits_met: float


class Around(NamedTuple):
    """What one vehicle's demand is computed from, besides its own settings."""

    known: Known
    led: Led


@dataclass(slots=True)
class Workspace:
    """Motions (3, 4) and vectors (3) of one vehicle's turn in one channel, reused for the next; a record.

    leader, leader_later: the leader as predicted last, when the command holds and later, and leader_ns for when:
    vehicles of one kind ask for the same.
    """

    leader_ns: Annotated[NDArray[np.int64], Layout(np.int64, (2,))]
    leader: Motion
    leader_later: Motion
    mine: Motion
    lead: Motion
    lead_later: Motion
    error: Motion
    slot: Motion
    frame: Motion
    lab: Motion
    lab_later: Motion
    force: Vec3
    feedback: Vec3
    feedback_rate: Vec3


WORKSPACE = dtype_of(Workspace)


def demand(
    settings: Rows[LawSettings], observers: Rows[ObserverSettings], estimates: Rows[VehicleEstimate],
    history: Rows[SentCommands], led: Led, memory: Rows[LawMemory], now_ns: int,
) -> Rows[Demand]:  # fmt: skip
    """The law at now_ns for the m commanded vehicles among the n."""
    out = blank(Demand, len(settings))
    _demand(settings, observers, estimates, history, led, memory, now_ns, out)
    return out


@kernel
def composite_acceleration(reference_acc: float, feedback_acc: float, z3: float) -> float:
    """Eq. (7): g(x) u + f(x) = lambda_d'' - c e' - t_m - Z3, one axis in `lab`.

    reference_acc: lambda_d'' as seen in `lab`; feedback_acc: -c e' - t_m, turned there; z3: Z3, the disturbance.
    """
    return reference_acc + feedback_acc - z3


@kernel
def _demand(
    settings: Rows[LawSettings], observers: Rows[ObserverSettings], estimates: Rows[VehicleEstimate],
    history: Rows[SentCommands], led: Led, memory: Rows[LawMemory], now_ns: int, out: Rows[Demand],
) -> None:  # fmt: skip
    """See `demand`; out (m) is filled."""
    around = Around(Known(estimates, observers, history), led)
    # A record keeps no array alive that it lies in: `space` has to be there as long as anybody writes into it.
    space = np.empty(2, WORKSPACE)
    for channel in range(2):
        space[channel].leader_ns[:] = NEVER_NS
    for i in range(len(settings)):
        _vehicle_demand(i, settings[i], around, memory[i], now_ns, space, out[i])


@kernel
def _vehicle_demand(
    i: int, law: LawSettings, around: Around, kept: LawMemory, now_ns: int, space: Rows[Workspace], out: Demand
) -> None:
    """One vehicle's turn."""
    dt_s = 0.0
    if kept.asked_ns > NEVER_NS:
        dt_s = min((now_ns - kept.asked_ns) * SECONDS, STEP_MAX_S)
    at_ns = min(now_ns, around.known.estimates[law.vehicle].t_ns + HORIZON_MAX_NS)
    _horizontal_demand(i, law, around, kept, at_ns, dt_s, space[HORIZONTAL], out)
    _vertical_demand(i, law, around, kept, at_ns, dt_s, space[VERTICAL], out)


@kernel
def _horizontal_demand(
    i: int, law: LawSettings, around: Around, kept: LawMemory, now_ns: int, dt_s: float, w: Workspace, out: Demand
) -> None:
    """x and y, by attitude."""
    known, n = around.known, law.vehicle
    lag_s = known.observers[n].response.attitude_lag_s
    arrival_ns = now_ns + int(attitude_dead_s(known.estimates[n], known.observers[n]) * 1e9)
    hold_ns = arrival_ns if law.compensate else known.estimates[n].t_ns
    situation(i, n, around, hold_ns, hold_ns + int(lag_s * 1e9) if law.compensate else NEVER_NS, w)
    gain = _adaptive_gain(i, law, around)
    boost = gain**law.lag_compensation.p1_power
    for axis in range(2):
        _feed_back(
            axis, law.horizontal, law.speed_max_m_s, boost, kept, around.led.references[i].airborne, dt_s, w, out
        )
    _add_turn_terms(w.frame, w.error, w.feedback)
    _into_lab(w.frame[0, 3], w.feedback)
    _into_lab(w.frame[0, 3], w.feedback_rate)
    copy_motion(w.mine, out.motion)
    if not law.compensate:  # its turn is bounded from the arrival's force all the same
        motion_at(known, n, arrival_ns, w.lead_later, w.force)
    for axis in range(3):
        out.specific_force_lab_m_s2[axis] = w.force[axis]
    pull = law.lag_compensation.gain * gain**law.lag_compensation.gain_power - 1.0
    z3 = known.estimates[n].dist_lab_m_s2
    for axis in range(2):
        _ask(axis, law.horizontal, z3[axis], w, out)
    bound_sideways(out.acc_lab_m_s2)
    for axis in range(2):
        if law.compensate:
            _invert_lag(axis, lag_s * law.lag_compensation.rate, pull, z3[axis], w, out)


@kernel
def _vertical_demand(
    i: int, law: LawSettings, around: Around, kept: LawMemory, now_ns: int, dt_s: float, w: Workspace, out: Demand
) -> None:
    """z, by thrust; and the heading, which a target reaches as soon (its rate is fed forward)."""
    known, n = around.known, law.vehicle
    dead_s, lag_s = known.observers[n].response.thrust_dead_s, known.observers[n].response.thrust_lag_s
    hold_ns = now_ns + int(dead_s * 1e9)
    situation(i, n, around, hold_ns, hold_ns + int(lag_s * 1e9), w)
    out.yaw_rad, out.yaw_rate_rad_s = w.lab[0, 3], w.lab[1, 3]
    z3 = known.estimates[n].dist_lab_m_s2[2]
    for axis in range(2, 3):  # as a plain 2 it would be a type of its own to numba, and compiled again
        _feed_back(axis, law.vertical, law.speed_max_m_s, 1.0, kept, around.led.references[i].airborne, dt_s, w, out)
        _ask(axis, law.vertical, z3, w, out)
        _invert_lag(axis, lag_s * law.lag_compensation.rate, 0.0, z3, w, out)
    for order in range(3):
        out.motion[order, 2] = w.mine[order, 2]
    size = sqrt(w.force[0] * w.force[0] + w.force[1] * w.force[1] + w.force[2] * w.force[2])
    out.tilt_cos = w.force[2] / size if size > 1.0 else 1.0


@kernel
def _adaptive_gain(i: int, law: LawSettings, around: Around) -> float:
    """The vehicle's own, or that of the leader it follows, if that one is only observed."""
    own: float = around.known.estimates[law.vehicle].adaptive_gain
    if around.led.references[i].kind == SLOT and around.known.observers[LEADER].place < 0:
        led: float = around.known.estimates[LEADER].adaptive_gain ** law.lag_compensation.lead_share
        return max(own, led)
    return own


@kernel
def situation(i: int, n: int, around: Around, hold_ns: int, later_ns: int, w: Workspace) -> None:
    """Vehicle i's own motion, reference and error at hold_ns, and its reference at later_ns, into the workspace.

    later_ns: NEVER_NS where the lag is not compensated.
    """
    known, numbers, knots = around.known, around.led.numbers, around.led.knots
    reference = around.led.references[i]
    _leader_ahead(around, hold_ns, later_ns, w)
    if later_ns > NEVER_NS:
        reference_at(reference, numbers, knots, later_ns, w.lead_later, w.slot, w.frame, w.lab_later)
    motion_at(known, n, hold_ns, w.mine, w.force)
    reference_at(reference, numbers, knots, hold_ns, w.lead, w.slot, w.frame, w.lab)
    lead_from_lab(w.mine, w.frame, w.error)
    for order in range(3):
        for column in range(4):
            w.error[order, column] -= w.slot[order, column]


@kernel
def _leader_ahead(around: Around, hold_ns: int, later_ns: int, w: Workspace) -> None:
    """The leader's motion at hold_ns, and at later_ns if that is wanted, into the workspace.

    A leader we command is taken to accelerate and turn as its own reference says: known ahead, and free of noise.
    """
    if w.leader_ns[0] != hold_ns or w.leader_ns[1] != later_ns:
        w.leader_ns[0], w.leader_ns[1] = hold_ns, later_ns
        motion_at(around.known, LEADER, hold_ns, w.leader, w.force)
        shifted(around.led.leader, hold_ns, w.leader)
        place = around.known.observers[LEADER].place
        if later_ns > NEVER_NS and place >= 0:
            _as_referred(around.led.references[place], around, hold_ns, later_ns, w)
        elif later_ns > NEVER_NS:
            motion_at(around.known, LEADER, later_ns, w.leader_later, w.force)
            shifted(around.led.leader, later_ns, w.leader_later)
    copy_motion(w.leader, w.lead)
    copy_motion(w.leader_later, w.lead_later)


@kernel
def _as_referred(reference: VehicleReference, around: Around, hold_ns: int, later_ns: int, w: Workspace) -> None:
    """A commanded leader's motion later: from `leader` on as its reference goes, and accelerations of both."""
    now, later = w.leader, w.leader_later
    reference_at(reference, around.led.numbers, around.led.knots, later_ns, now, w.slot, w.frame, w.lab_later)
    reference_at(reference, around.led.numbers, around.led.knots, hold_ns, now, w.slot, w.frame, w.lab)
    for column in range(4):
        for order in range(2):
            later[order, column] = now[order, column] + w.lab_later[order, column] - w.lab[order, column]
        now[2, column], later[2, column] = w.lab[2, column], w.lab_later[2, column]


@kernel
def _feed_back(
    axis: int, gains: AxisGains, speed_max: float, boost: float, kept: LawMemory, airborne: bool, dt_s: float,
    w: Workspace, out: Demand,
) -> None:  # fmt: skip
    """Eqs. (5)-(6) of one axis: error, sliding variable, t_m and the new z_m; its feedback into the workspace."""
    e, e_rate, e_acc, before = w.error[0, axis], w.error[1, axis], w.error[2, axis], kept.z_m[axis]
    s, t_m, z_m, w.feedback[axis], w.feedback_rate[axis] = feedback(
        gains, e, e_rate, e_acc, before, boost, speed_max, dt_s
    )
    out.e_lead_m[axis], out.e_rate_lead_m_s[axis], out.s_lead_m_s[axis], out.t_m_lead_m_s2[axis] = e, e_rate, s, t_m
    out.z_m_lead_m_s2[axis] = before if kept.saturated and abs(z_m) > abs(before) else z_m
    if not airborne:
        out.z_m_lead_m_s2[axis] = 0.0


@kernel
def _ask(axis: int, gains: AxisGains, z3: float, w: Workspace, out: Demand) -> None:
    """Eq. (7) of one axis in `lab`."""
    z3_used = z3 if uses_disturbance(gains) else 0.0
    out.acc_lab_m_s2[axis] = composite_acceleration(w.lab[2, axis], w.feedback[axis], z3_used)


@kernel
def _invert_lag(axis: int, ahead_s: float, pull: float, z3: float, w: Workspace, out: Demand) -> None:
    """What is added to one axis's demand to invert the lag.

    ahead_s: how far the feedback's own rate is sent ahead; pull: how much harder than needed the command pulls at what
    the predicted acceleration misses.
    """
    coming = w.lab_later[2, axis] - w.lab[2, axis] + ahead_s * w.feedback_rate[axis]
    missing = out.acc_lab_m_s2[axis] - (w.mine[2, axis] - z3)
    out.lead_acc_lab_m_s2[axis] = coming + pull * missing


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

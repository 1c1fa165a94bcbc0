"""The formation law for all vehicles: from estimates, course and past commands to demanded accelerations (Eq. 7).

Each axis is judged at the time when a command sent now takes hold: own and leader's motions are predicted over the
dead time with the commands already sent, and the first-order lag is inverted with the demand's own rate.
"""

from dataclasses import dataclass
from math import cos, sin, sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from formation.control.feedback import feedback, uses_disturbance
from formation.control.prediction import Known, motion_at
from formation.control.relative_frame import copy_motion, lead_from_lab
from formation.estimation.state import EstimatorState
from formation.guidance.reference_generator import SLOT, Course, Way, reference_at
from formation.maths.arrays import Flags, Float, Scalars, Vec3s
from formation.maths.kernel import kernel
from formation.vehicle.response import History

HORIZON_MAX_NS = 400_000_000


@dataclass(frozen=True, slots=True)
class Quickness:
    """How hard the lag is inverted, and what the observer's activity mu (formation.estimation.state.Vigilance) adds.

    rate: share of the lag times the demand's own rate that is sent ahead; gain: lag over wanted lag, how much harder
    than needed the command pulls at what the predicted acceleration misses of the demand, times mu^gain_power;
    p1_power: p1 is multiplied by mu^p1_power; lead_share: a follower is at least as awake as the observer of a
    leader that is only seen, to this power.
    """

    rate: float = 1.0
    gain: float = 1.0
    gain_power: float = 0.0
    p1_power: float = 0.0
    lead_share: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class LawSettings:
    """Per commanded vehicle m unless said otherwise.

    horizontal, vertical (m, 7): gain rows of formation.control.feedback; response (n, 4): as the estimator's;
    vehicle (m): index among the n; own (n): place among the m or -1; compensate (m, 2): whether
    lag and dead time are, horizontally and vertically.
    manner (n, 12): as the estimator's; quickness (m, 5): as in Quickness;
    turn_dead_s (m): from a
    sent target to its arrival (the yaw loop, its rate fed forward, adds no more on the whole).
    """

    horizontal: Float
    vertical: Float
    response: Float
    vehicle: NDArray[np.int64]
    own: NDArray[np.int64]
    compensate: Flags
    speed_max_m_s: float
    manner: Float
    quickness: Float
    turn_dead_s: Float


@dataclass(frozen=True, slots=True, eq=False)
class Demand:
    """What the law asks of each vehicle, and the inside of how it got there; (m, 3) unless said otherwise.

    acc: demanded acceleration; lead_acc: what the lag's inversion adds to it; motion (m, 3, 4): predicted when the
    command is taken to hold; force (m, 3): modelled specific force when it arrives; lift_cos (m): predicted cosine of
    tilt when the thrust does; yaw (m, 2): heading and rate.
    """

    e: Vec3s
    e_rate: Vec3s
    s: Vec3s
    t_m: Vec3s
    memory: Vec3s
    acc: Vec3s
    lead_acc: Vec3s
    motion: Float
    force: Vec3s
    lift_cos: Float
    yaw: Float


def demand(
    settings: LawSettings, state: EstimatorState, course: Course, history: History, memory: Vec3s, frozen: Flags,
    turn_rad_s2: Scalars, now_ns: int, dt_s: float,
) -> Demand:  # fmt: skip
    """The law at now_ns, dt_s after it was last asked.

    memory (m, 3): z_m of Eq. (6), or a PID's integral; frozen (m): last target met a limit, so memory may not grow;
    turn_rad_s2 (n): as the estimator's.
    """
    m = len(settings.vehicle)
    seven = [np.zeros((m, 3)) for _ in range(7)]
    out = Demand(
        seven[0], seven[1], seven[2], seven[3], seven[4], seven[5], seven[6],
        np.zeros((m, 3, 4)), np.zeros((m, 3)), np.ones(m), np.zeros((m, 2)),
    )  # fmt: skip
    path = course.trajectory
    response, predicted = settings.response.copy(), settings.vehicle[settings.compensate[:, 0]]
    response[predicted, 0] = np.maximum(response[predicted, 0] - state.shift_s[predicted], 0.0)
    _demand(
        settings.horizontal, settings.vertical, response, settings.vehicle, settings.own,
        settings.compensate, settings.speed_max_m_s, settings.manner, settings.quickness,
        settings.turn_dead_s,
        state.t_ns, state.pos_lab_m, state.vel_lab_m_s, state.dist_lab_m_s2, state.force_lab_m_s2, state.force_rate,
        state.strength, state.heading, turn_rad_s2, state.activity, history.t_ns, history.force,
        course.kind, course.base, course.gap, course.gap_ns, course.gap_s, course.airborne, path.kind, path.numbers,
        path.knots, course.trajectory_ns,
        memory, frozen, min(now_ns, state.t_ns + HORIZON_MAX_NS), dt_s,
        out.e, out.e_rate, out.s, out.t_m, out.memory, out.acc, out.lead_acc, out.motion, out.force, out.lift_cos,
        out.yaw,
    )  # fmt: skip
    return out


class Bench(NamedTuple):
    """Scratch motions (3, 4) of one vehicle's turn, reused for the next."""

    mine: Float
    lead: Float
    lead_later: Float
    error: Float
    slot: Float
    frame: Float
    lab: Float
    lab_later: Float
    felt: Float
    back: Float
    back_rate: Float


@kernel
def _demand(
    horizontal: Float, vertical: Float, response: Float, vehicle: NDArray[np.int64], own: NDArray[np.int64],
    compensate: NDArray[np.bool_],
    speed_max: float, manner: Float, quickness: Float, turn_dead_s: Float,
    t_ns: int, pos: Float, vel: Float, dist: Float, force: Float, force_rate: Float, strength: Float,
    heading: Float, turn: Float, mu: Float, sent_ns: NDArray[np.int64], sent: Float,
    kind: NDArray[np.int64], base: Float, gap: Float, gap_ns: NDArray[np.int64], gap_s: Float,
    airborne: NDArray[np.bool_], path_kind: int, path_numbers: Float, path_knots: Float, path_ns: int,
    memory: Float, frozen: NDArray[np.bool_], now_ns: int, dt_s: float,
    e: Float, e_rate: Float, s: Float, t_m: Float, new_memory: Float, acc: Float, lead_acc: Float,
    motion: Float, felt: Float, lift_cos: Float, yaw: Float,
) -> None:  # fmt: skip
    """See `demand`; the out arrays are the fields of Demand."""
    known = Known(t_ns, pos, vel, dist, force, force_rate, strength, heading, turn, manner, response, sent_ns, sent)
    way = Way(kind, base, gap, gap_ns, gap_s, path_kind, path_numbers, path_knots, path_ns)
    b = Bench(
        np.empty((3, 4)), np.empty((3, 4)), np.empty((3, 4)), np.empty((3, 4)), np.empty((3, 4)), np.empty((3, 4)),
        np.empty((3, 4)), np.empty((3, 4)), np.empty(3), np.empty(3), np.empty(3),
    )  # fmt: skip
    for i in range(len(vehicle)):
        n = vehicle[i]
        # np.int64: a literal 0 would be a type of its own, and the prediction compiled once more for it.
        turned_ns = now_ns + int(turn_dead_s[i] * 1e9)
        motion_at(np.int64(0), own[0], turned_ns, known, b.lead, b.felt)
        reference_at(i, turned_ns, b.lead, way, b.slot, b.frame, b.lab)
        yaw[i, 0], yaw[i, 1] = b.lab[0, 3], b.lab[1, 3]
        for channel in range(2):
            dead_s, lag_s = response[n, 2 * channel], response[n, 2 * channel + 1]
            arrival_ns = now_ns + int(dead_s * 1e9)
            hold_ns = arrival_ns if compensate[i, channel] else t_ns
            _situation(i, n, own[0], hold_ns, hold_ns + int(lag_s * 1e9), compensate[i, channel], known, way, b)
            gains = horizontal[i] if channel == 0 else vertical[i]
            awake = mu[n]
            if way.kind[i] == SLOT and own[0] < 0:
                awake = max(awake, mu[0] ** quickness[i, 4])
            boost = awake ** quickness[i, 3] if channel == 0 else 1.0
            for axis in range(2 * channel, 2 + channel):
                s[i, axis], t_m[i, axis], kept, b.back[axis], b.back_rate[axis] = feedback(
                    gains, b.error[0, axis], b.error[1, axis], b.error[2, axis], memory[i, axis], boost, speed_max, dt_s
                )
                e[i, axis], e_rate[i, axis] = b.error[0, axis], b.error[1, axis]
                grows = abs(kept) > abs(memory[i, axis])
                new_memory[i, axis] = memory[i, axis] if frozen[i] and grows else kept
                if not airborne[i]:
                    new_memory[i, axis] = 0.0
            if channel == 0:
                _turn_terms(b.frame, b.error, b.back)
                _into_lab(b.frame[0, 3], b.back)
                _into_lab(b.frame[0, 3], b.back_rate)
                copy_motion(b.mine, motion[i])
                if not compensate[i, channel]:  # its turn is bounded from the arrival's force all the same
                    motion_at(n, i, arrival_ns, known, b.lead_later, b.felt)
                for axis in range(3):
                    felt[i, axis] = b.felt[axis]
            else:
                for order in range(3):
                    motion[i, order, 2] = b.mine[order, 2]
                size = sqrt(b.felt[0] * b.felt[0] + b.felt[1] * b.felt[1] + b.felt[2] * b.felt[2])
                lift_cos[i] = b.felt[2] / size if size > 1.0 else 1.0
            pull = quickness[i, 1] * awake ** quickness[i, 2] - 1.0 if channel == 0 else 0.0
            for axis in range(2 * channel, 2 + channel):
                acc[i, axis] = b.lab[2, axis] + b.back[axis]
                if uses_disturbance(gains):
                    acc[i, axis] -= dist[n, axis]
                if compensate[i, channel]:
                    coming = b.lab_later[2, axis] - b.lab[2, axis] + lag_s * quickness[i, 0] * b.back_rate[axis]
                    missing = acc[i, axis] - (b.mine[2, axis] - dist[n, axis])
                    lead_acc[i, axis] = coming + pull * missing


@kernel
def _situation(
    i: int, n: int, leader: int, hold_ns: int, later_ns: int, compensate: bool, known: Known, way: Way, b: Bench
) -> None:
    """Vehicle i's own motion, reference and error at hold_ns, and its reference at later_ns, onto the bench.

    A leader we command is taken to accelerate and turn as its own reference says: known ahead, and free of noise.
    """
    motion_at(np.int64(0), leader, hold_ns, known, b.lead, b.felt)
    if compensate:
        if leader >= 0:
            reference_at(leader, later_ns, b.lead, way, b.slot, b.frame, b.lab_later)
            reference_at(leader, hold_ns, b.lead, way, b.slot, b.frame, b.lab)
            for column in range(4):
                for order in range(2):
                    b.lead_later[order, column] = (
                        b.lead[order, column] + b.lab_later[order, column] - b.lab[order, column]
                    )
                b.lead[2, column], b.lead_later[2, column] = b.lab[2, column], b.lab_later[2, column]
        else:
            motion_at(np.int64(0), leader, later_ns, known, b.lead_later, b.felt)
        reference_at(i, later_ns, b.lead_later, way, b.slot, b.frame, b.lab_later)
    motion_at(n, i, hold_ns, known, b.mine, b.felt)
    reference_at(i, hold_ns, b.lead, way, b.slot, b.frame, b.lab)
    lead_from_lab(b.mine, b.frame, b.error)
    for order in range(3):
        for column in range(4):
            b.error[order, column] -= b.slot[order, column]


@kernel
def _turn_terms(frame: Float, error: Float, back: Float) -> None:
    """Adds the Coriolis, Euler and centripetal terms of the error itself; the slot's own are in its lab motion."""
    w, alpha = frame[1, 3], frame[2, 3]
    back[0] += -2.0 * w * error[1, 1] - alpha * error[0, 1] - w * w * error[0, 0]
    back[1] += 2.0 * w * error[1, 0] + alpha * error[0, 0] - w * w * error[0, 1]


@kernel
def _into_lab(heading: float, v: Float) -> None:
    """Turns a lead vector (3) into `lab`, in place."""
    c, s = cos(heading), sin(heading)
    x, y = v[0], v[1]
    v[0], v[1] = c * x - s * y, s * x + c * y

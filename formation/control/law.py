"""The formation law for all vehicles: from estimates, course and past commands to demanded accelerations (Eq. 7).

Each axis is judged at the time when a command sent now takes hold: own and leader's motions are predicted over the
dead time with the commands already sent, and the first-order lag is inverted with the demand's own rate.
"""

from dataclasses import dataclass
from math import cos, sin

import numpy as np
from numpy.typing import NDArray

from formation.arrays import Flags, Float, Vec3s
from formation.control.feedback import feedback, uses_disturbance
from formation.control.prediction import motion_at
from formation.course import Course, reference_at
from formation.estimate import EstimatorState
from formation.kernel import kernel
from formation.relative import lead_from_lab
from formation.response import History

HORIZON_MAX_NS = 400_000_000


@dataclass(frozen=True, slots=True, eq=False)
class LawSettings:
    """Per commanded vehicle m unless said otherwise.

    horizontal, vertical (m, 7): gain rows of formation.control.feedback; response (n, 4): as the estimator's;
    vehicle (m): index among the n; own (n): place among the m or -1; compensate: whether lag and dead time are.
    """

    horizontal: Float
    vertical: Float
    response: Float
    vehicle: NDArray[np.int64]
    own: NDArray[np.int64]
    compensate: bool
    speed_max_m_s: float


@dataclass(frozen=True, slots=True, eq=False)
class Demand:
    """What the law asks of each vehicle, and the inside of how it got there; (m, 3) unless said otherwise.

    acc: demanded acceleration; lead_acc: what the lag's inversion adds to it; motion (m, 3, 4): predicted when the
    command takes hold; lift_cos (m): predicted cosine of tilt when the thrust does; yaw (m, 2): heading and rate.
    """

    e: Vec3s
    e_rate: Vec3s
    s: Vec3s
    t_m: Vec3s
    memory: Vec3s
    acc: Vec3s
    lead_acc: Vec3s
    motion: Float
    lift_cos: Float
    yaw: Float


def demand(
    settings: LawSettings, state: EstimatorState, course: Course, history: History, memory: Vec3s, frozen: Flags,
    now_ns: int, dt_s: float,
) -> Demand:  # fmt: skip
    """The law at now_ns, dt_s after it was last asked.

    memory (m, 3): z_m of Eq. (6), or a PID's integral; frozen (m): last target met a limit, so memory may not grow.
    """
    m = len(settings.vehicle)
    seven = [np.zeros((m, 3)) for _ in range(7)]
    out = Demand(
        seven[0], seven[1], seven[2], seven[3], seven[4], seven[5], seven[6],
        np.zeros((m, 3, 4)), np.ones(m), np.zeros((m, 2)),
    )  # fmt: skip
    path = course.trajectory
    _demand(
        settings.horizontal, settings.vertical, settings.response, settings.vehicle, settings.own,
        settings.compensate, settings.speed_max_m_s,
        state.t_ns, state.pos_lab_m, state.vel_lab_m_s, state.dist_lab_m_s2, state.force_lab_m_s2, state.strength,
        state.heading, history.t_ns, history.force,
        course.kind, course.base, course.gap, course.gap_ns, course.gap_s, course.airborne, path.kind, path.numbers,
        path.knots, course.trajectory_ns,
        memory, frozen, min(now_ns, state.t_ns + HORIZON_MAX_NS), dt_s,
        out.e, out.e_rate, out.s, out.t_m, out.memory, out.acc, out.lead_acc, out.motion, out.lift_cos, out.yaw,
    )  # fmt: skip
    return out


@kernel
def _demand(
    horizontal: Float, vertical: Float, response: Float, vehicle: NDArray[np.int64], own: NDArray[np.int64],
    compensate: bool, speed_max: float,
    t_ns: int, pos: Float, vel: Float, dist: Float, force: Float, strength: Float,
    heading: Float, sent_ns: NDArray[np.int64], sent: Float,
    kind: NDArray[np.int64], base: Float, gap: Float, gap_ns: NDArray[np.int64], gap_s: Float,
    airborne: NDArray[np.bool_], path_kind: int, path_numbers: Float, path_knots: Float, path_ns: int,
    memory: Float, frozen: NDArray[np.bool_], now_ns: int, dt_s: float,
    e: Float, e_rate: Float, s: Float, t_m: Float, new_memory: Float, acc: Float, lead_acc: Float,
    motion: Float, lift_cos: Float, yaw: Float,
) -> None:  # fmt: skip
    """See `demand`; the out arrays are the fields of Demand."""
    mine, lead, error = np.empty((3, 4)), np.empty((3, 4)), np.empty((3, 4))
    slot, frame, lab = np.empty((3, 4)), np.empty((3, 4)), np.empty((3, 4))
    lead_later, lab_later = np.empty((3, 4)), np.empty((3, 4))
    felt = np.empty(3)
    back, back_rate = np.zeros(3), np.zeros(3)
    for i in range(len(vehicle)):
        n = vehicle[i]
        for channel in range(2):
            dead_s, lag_s = response[n, 2 * channel], response[n, 2 * channel + 1]
            hold_ns = now_ns + int(dead_s * 1e9) if compensate else t_ns
            motion_at(
                n, i, hold_ns, t_ns, pos, vel, dist, force, strength, heading, response, sent_ns, sent, mine, felt,
            )  # fmt: skip
            motion_at(
                0, own[0], hold_ns, t_ns, pos, vel, dist, force, strength, heading, response, sent_ns, sent, lead,
                slot[0],
            )  # fmt: skip
            if channel == 0:
                motion[i] = mine
            else:
                motion[i, :, 2] = mine[:, 2]
                size = np.sqrt(felt[0] * felt[0] + felt[1] * felt[1] + felt[2] * felt[2])
                lift_cos[i] = felt[2] / size if size > 1.0 else 1.0
            if compensate:
                _later(
                    hold_ns, lag_s, own[0], lead, kind, base, gap, gap_ns, gap_s, path_kind, path_numbers,
                    path_knots, path_ns, lead_later, slot, frame, lab,
                )  # fmt: skip
                reference_at(
                    i, hold_ns + int(lag_s * 1e9), lead_later, kind, base, gap, gap_ns, gap_s, path_kind,
                    path_numbers, path_knots, path_ns, slot, frame, lab_later,
                )  # fmt: skip
            reference_at(
                i, hold_ns, lead, kind, base, gap, gap_ns, gap_s, path_kind, path_numbers, path_knots, path_ns,
                slot, frame, lab,
            )  # fmt: skip
            lead_from_lab(mine, frame, error)
            error -= slot
            gains = horizontal[i] if channel == 0 else vertical[i]
            for axis in range(2 * channel, 2 + channel):
                out = feedback(gains, error[0, axis], error[1, axis], error[2, axis], memory[i, axis], speed_max, dt_s)
                e[i, axis], e_rate[i, axis], s[i, axis], t_m[i, axis] = error[0, axis], error[1, axis], out[0], out[1]
                grows = abs(out[2]) > abs(memory[i, axis])
                new_memory[i, axis] = memory[i, axis] if frozen[i] and grows else out[2]
                if not airborne[i]:
                    new_memory[i, axis] = 0.0
                back[axis], back_rate[axis] = out[3], out[4]
                acc[i, axis] = lab[2, axis]
                if uses_disturbance(gains):
                    acc[i, axis] -= dist[n, axis]
                if compensate:
                    lead_acc[i, axis] = lab_later[2, axis] - lab[2, axis]
            if channel == 0:
                yaw[i, 0], yaw[i, 1] = lab[0, 3], lab[1, 3]
                _turn_terms(frame, error, back)
                c, sn = cos(frame[0, 3]), sin(frame[0, 3])
                acc[i, 0] += c * back[0] - sn * back[1]
                acc[i, 1] += sn * back[0] + c * back[1]
                if compensate:
                    lead_acc[i, 0] += lag_s * (c * back_rate[0] - sn * back_rate[1])
                    lead_acc[i, 1] += lag_s * (sn * back_rate[0] + c * back_rate[1])
            else:
                acc[i, 2] += back[2]
                if compensate:
                    lead_acc[i, 2] += lag_s * back_rate[2]


@kernel
def _turn_terms(frame: Float, error: Float, back: Float) -> None:
    """Adds the Coriolis, Euler and centripetal terms of the error itself; the slot's own are in its lab motion."""
    w, alpha = frame[1, 3], frame[2, 3]
    back[0] += -2.0 * w * error[1, 1] - alpha * error[0, 1] - w * w * error[0, 0]
    back[1] += 2.0 * w * error[1, 0] + alpha * error[0, 0] - w * w * error[0, 1]


@kernel
def _later(
    hold_ns: int, lag_s: float, leader: int, lead: Float, kind: NDArray[np.int64], base: Float, gap: Float,
    gap_ns: NDArray[np.int64], gap_s: Float, path_kind: int, path_numbers: Float, path_knots: Float, path_ns: int,
    lead_later: Float, slot: Float, frame: Float, lab: Float,
) -> None:  # fmt: skip
    """The leader's motion one lag after hold_ns: along its own reference if we command it, else by its acceleration.

    slot, frame and lab are scratch.
    """
    if leader >= 0:
        reference_at(
            leader, hold_ns + int(lag_s * 1e9), lead, kind, base, gap, gap_ns, gap_s, path_kind, path_numbers,
            path_knots, path_ns, slot, frame, lab,
        )  # fmt: skip
        lead_later[:] = lead + lab
        reference_at(
            leader, hold_ns, lead, kind, base, gap, gap_ns, gap_s, path_kind, path_numbers, path_knots, path_ns,
            slot, frame, lab,
        )  # fmt: skip
        lead_later -= lab
        return
    lead_later[2] = lead[2]
    lead_later[1] = lead[1] + lag_s * lead[2]
    lead_later[0] = lead[0] + lag_s * lead[1] + 0.5 * lag_s * lag_s * lead[2]

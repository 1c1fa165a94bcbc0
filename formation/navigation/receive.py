"""What enters the navigator, checked: each input of k bodies in one call, and why one is rejected."""

from enum import IntEnum
from math import isfinite, sqrt

import numpy as np
from numpy.typing import NDArray

from formation.maths.arrays import Float
from formation.maths.copying import copy_into
from formation.maths.kernel import kernel
from formation.maths.quaternion import turn_flu_rad
from formation.maths.records import Rows
from formation.messages import FARTHEST_M, FORCE_MOST_M_S2
from formation.navigation.evidence import Bank
from formation.navigation.fusion import GAP_S, LATEST_NS, advance
from formation.navigation.samples import add_sample, measures_force
from formation.navigation.state import AUTOPILOT_ATTITUDE, POSE_POSITION, SAMPLES, THRUSTS, Body

RATE_MOST_RAD_S = 35.0
"""2000 degrees/s along an axis: no gyroscope of an autopilot shows more."""
Ints = NDArray[np.int64]


class RejectReason(IntEnum):
    """Why an input was not used; NONE where it was."""

    NONE = 0
    NOT_FINITE = 1
    IMPOSSIBLE = 2
    OUT_OF_ORDER = 3
    TOO_OLD = 4
    FROZEN = 5


class Input(IntEnum):
    """What enters."""

    IMU = 0
    ATTITUDE = 1
    POSE = 2
    THRUST = 3


_NONE, _NOT_FINITE, _IMPOSSIBLE, _OUT_OF_ORDER, _TOO_OLD, _FROZEN = range(6)
_IMU, _ATTITUDE, _POSE, _THRUST = range(4)


@kernel
def receive_imu(bodies: Rows[Body], rejected: Ints, which: Ints, t_ns: Ints, force: Float, rate: Float) -> None:
    """Inertial samples of bodies `which` (k): times (k), specific forces and rates in `flu` (k, 3)."""
    for k in range(len(which)):
        body = bodies[which[k]]
        ring = body.inertial
        reason = _vector_reason(force[k], FORCE_MOST_M_S2)
        if reason == _NONE:
            reason = _vector_reason(rate[k], RATE_MOST_RAD_S)
        if reason == _NONE and ring.count > 0 and t_ns[k] <= ring.t_ns[(ring.count - 1) % SAMPLES]:
            reason = _OUT_OF_ORDER
        rejected[which[k], _IMU, reason] += 1
        if reason == _NONE:
            add_sample(body, t_ns[k], force[k], rate[k], np.nan)


@kernel
def receive_attitude(bodies: Rows[Body], rejected: Ints, which: Ints, t_ns: Ints, q: Float, rate: Float) -> None:
    """The autopilot's attitudes (k, 4) and rates (k, 3); where there is no accelerometer, thrust and rates are used.

    An inertial sample is a mean, and a gust changes the rate by 5 rad/s from one of these to the next: so the mean rate
    is what the attitude has turned by since the last one, as uncertain as two attitudes are.
    """
    for k in range(len(which)):
        body = bodies[which[k]]
        ring, pending, no_force = body.inertial, body.pending, np.full(3, np.nan)
        attitude, mean_rate = np.empty(4), np.empty(3)
        reason = max(_unit(q[k], attitude), _vector_reason(rate[k], RATE_MOST_RAD_S))
        last_ns = max(pending.attitude_t_ns, body.innovations.t_ns[AUTOPILOT_ATTITUDE])
        if reason == _NONE and t_ns[k] <= last_ns:
            reason = _OUT_OF_ORDER
        if reason == _NONE and body.status.begun and t_ns[k] < body.estimate.t_ns - LATEST_NS:
            reason = _TOO_OLD
        rejected[which[k], _ATTITUDE, reason] += 1
        if reason != _NONE:
            continue
        at = (ring.count - 1) % SAMPLES
        modelled = not measures_force(ring)
        if ring.count == 0 or t_ns[k] - ring.t_ns[at] > (0.0 if modelled else GAP_S * 1e9):
            copy_into(rate[k], mean_rate)
            rate_var = np.nan
            if ring.count > 0 and ring.t_ns[at] == last_ns:
                dt_s = (t_ns[k] - last_ns) * 1e-9
                copy_into(turn_flu_rad(pending.q_lab_from_flu_autopilot, attitude) / dt_s, mean_rate)
                rate_var = 2.0 * body.noise.source[AUTOPILOT_ATTITUDE] / (dt_s * dt_s)
            add_sample(body, t_ns[k], no_force, mean_rate, rate_var)
        pending.attitude_t_ns = t_ns[k]
        copy_into(attitude, pending.q_lab_from_flu_autopilot)


@kernel
def receive_pose(bodies: Rows[Body], rejected: Ints, which: Ints, t_ns: Ints, pos: Float, q: Float) -> None:
    """Poses (k, 3) and (k, 4) at their stamps (k)."""
    for k in range(len(which)):
        body = bodies[which[k]]
        pending, attitude = body.pending, np.empty(4)
        reason = max(_vector_reason(pos[k], FARTHEST_M), _unit(q[k], attitude))
        if reason == _NONE and pending.count > 0 and t_ns[k] <= pending.t_ns[pending.count - 1]:
            reason = _OUT_OF_ORDER
        if reason == _NONE and body.status.begun and t_ns[k] <= body.estimate.t_ns:
            reason = _OUT_OF_ORDER if t_ns[k] <= body.innovations.t_ns[POSE_POSITION] else _TOO_OLD
        if reason == _NONE and _is_same(pos[k], pending.last_pos_lab_m) and _is_same(q[k], pending.last_q_lab_from_flu):
            reason = _FROZEN
        rejected[which[k], _POSE, reason] += 1
        if reason == _NONE:
            copy_into(pos[k], pending.last_pos_lab_m)
            copy_into(q[k], pending.last_q_lab_from_flu)
            at = pending.count
            pending.t_ns[at] = t_ns[k]
            copy_into(pos[k], pending.pos_lab_m[at])
            copy_into(attitude, pending.q_lab_from_flu[at])
            pending.count += 1


@kernel
def receive_thrust(bodies: Rows[Body], rejected: Ints, which: Ints, t_ns: Ints, thrust_m_s2: Float) -> None:
    """Commanded thrusts (k), as specific force; NaN: from now on it is not known."""
    for k in range(len(which)):
        ring = bodies[which[k]].commanded
        reason = _NONE
        if ring.count > 0 and t_ns[k] < ring.t_ns[(ring.count - 1) % THRUSTS]:
            reason = _OUT_OF_ORDER
        elif abs(thrust_m_s2[k]) > FORCE_MOST_M_S2:
            reason = _IMPOSSIBLE
        rejected[which[k], _THRUST, reason] += 1
        if reason == _NONE:
            at = ring.count % THRUSTS
            ring.t_ns[at] = t_ns[k]
            ring.thrust_m_s2[at] = thrust_m_s2[k]
            ring.count += 1


@kernel
def advance_bodies(bodies: Rows[Body], bank: Bank, which: Ints) -> bool:
    """Uses what bodies `which` (k) have received, as far as it can be; whether it shows a fault. After every input."""
    found = False
    for k in range(len(which)):
        fault = bodies[which[k]].fault
        before_ns = fault.t_ns
        advance(bodies[which[k]], bank, which[k])
        found |= fault.t_ns != before_ns
    return found


@kernel
def _vector_reason(vector: Float, most: float) -> int:
    """Why a vector (3) cannot be, NONE where it can."""
    reason = _NONE
    for axis in range(3):
        if not isfinite(vector[axis]):
            return _NOT_FINITE
        if abs(vector[axis]) > most:
            reason = _IMPOSSIBLE
    return reason


@kernel
def _is_same(new: Float, last: Float) -> bool:
    """Whether two observations are equal to the last bit: no camera shows a body twice so."""
    same = True
    for k in range(len(new)):
        same &= new[k] == last[k]
    return same


@kernel
def _unit(q: Float, out: Float) -> int:
    """The unit quaternion of q, w >= 0, into out (4); why there is none. Wires round q by a thousandth at most."""
    square = q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]
    if not isfinite(square):
        return _NOT_FINITE
    if abs(square - 1.0) > 0.02:
        return _IMPOSSIBLE
    scale = (1.0 if q[0] >= 0.0 else -1.0) / sqrt(square)
    for k in range(4):
        out[k] = scale * q[k]
    return _NONE

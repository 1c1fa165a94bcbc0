"""What each source does to one body: inertial samples, commanded thrust, autopilot's attitude, mocap's poses.

The estimate stands at the newest pose used (its horizon). Inertial samples later than that wait in a ring; a pose
waits until the samples reach its stamp, then the estimate is predicted to it and corrected: nothing is ever fused
late, so that neither states nor covariances have to be rewound. Where the body is now is predicted from the horizon
through the ring (`predicted`), as PX4's output predictor does, at no cost in optimality. With no pose the horizon
follows LATEST_NS behind. The autopilot's attitude is compared with the prediction of its time: an attitude error in
`lab` does not change as the body turns, so that it corrects the horizon.
"""

from math import isfinite, sqrt

import numpy as np

from formation.maths.arrays import Float
from formation.maths.copying import copy_into
from formation.maths.kernel import kernel
from formation.maths.quaternion import rotate_into, turn_into
from formation.navigation.error_state import inject, innovation_variance, predict, rotation_vector_into
from formation.navigation.evidence import ONSETS, Bank, add_onset, copy_estimate, find_fault, reset_onsets
from formation.navigation.observe import TEST_SIGMAS, learn, record, use, use_attitude, use_thrust
from formation.navigation.samples import follow_thrust, measures_force, model_force, next_sample
from formation.navigation.state import (
    ATT,
    BIAS,
    DELAY,
    ERRORS,
    LEVEL,
    PENDING,
    POS,
    POSE_ATTITUDE,
    POSE_POSITION,
    SAMPLES,
    SCALE,
    STAMP,
    VEL,
    Body,
    Estimate,
)
from formation.vehicle.body import GRAVITY_M_S2

LATEST_NS = 200_000_000
"""Behind the newest inertial sample no pose is used any more: PX4's EKF2_DELAY_MAX."""
GAP_S = 0.06
"""Between inertial samples: beyond, the motion between is unknown (three samples lost at 50 Hz)."""
UNKNOWN_FORCE_M_S2, UNKNOWN_RATE_RAD_S = 5.0, 2.0
"""RMS of what moves a body that no sensor measures: half a g, a brisk turn."""
MODELLED_FORCE_M_S2, MODELLED_CORRELATION_S = 1.0, 0.3
"""RMS of what thrust and drag miss of the specific force, and for how long: a gust, or the response to a command."""
REACQUIRE_NS = 500_000_000
"""So long poses must be consistent before they are used again: as today's."""
ALONE_NS = 5_000_000_000
"""After so long without a pose, dead reckoning says less than a pose that stays: the estimate begins anew."""
FORCE_FLOOR_M_S2, RATE_FLOOR_RAD_S = 0.02, 0.03
"""Least RMS noise of a sample: of an accelerometer of 100 ug per root Hz; of a gyroscope its bias, counted as noise."""
RATE_SHARE = 0.05
"""Of the body rate: the gyroscope's axes are up to 3 degrees off those of the markers."""
FIRST_VEL_M_S, FIRST_BIAS_M_S2, FIRST_LEVEL_RAD, FIRST_SCALE, FIRST_DELAY_S = 1.0, 0.5, 0.1, 0.2, 0.02
"""What is not known at first, RMS: markers tilted by 2 degrees show as 0.35 m/s^2."""
STAMP_SCATTER_S = 0.0003
"""RMS: of clocks by TIMESYNC, of frames that are re-timed."""
TIMED_VEL_M_S = 0.1
"""RMS error of the velocity at which a first delay is a matter of 2 mm."""


@kernel
def coast(body: Body, until_ns: int, bank: Bank, i: int) -> None:
    """Predicts the estimate to until_ns by the samples of that time, and uses their force to learn the thrust scale."""
    x, ring = body.estimate, body.inertial
    number = next_sample(ring, x.t_ns)
    response = bank.response[i]
    while x.t_ns < until_ns:
        force, rate, force_var, rate_var = np.zeros(3), np.zeros(3), np.empty(3), np.empty(3)
        end_ns, known, whole, at = until_ns, False, False, 0
        if number < ring.count:
            at = number % SAMPLES
            whole = ring.t_ns[at] <= until_ns
            end_ns = min(ring.t_ns[at], until_ns)
            known = (ring.t_ns[at] - x.t_ns) * 1e-9 <= GAP_S
            copy_into(ring.force_flu_m_s2[at], force)
            copy_into(ring.rate_flu_rad_s[at], rate)
        dt_s = (end_ns - x.t_ns) * 1e-9
        span_s = dt_s
        if known and number > 0:
            span_s = max(min((ring.t_ns[at] - ring.t_ns[(number - 1) % SAMPLES]) * 1e-9, GAP_S), dt_s)
        turns = rate[0] * rate[0] + rate[1] * rate[1] + rate[2] * rate[2]
        least_rate_var = RATE_FLOOR_RAD_S * RATE_FLOOR_RAD_S + RATE_SHARE * RATE_SHARE * turns
        modelled = follow_thrust(body, dt_s)
        measured = isfinite(force[0])
        if not measured or not known:
            measured = False
            model_force(body, modelled, force)
        for axis in range(3):
            force_var[axis] = max(body.noise.force_m2_s4[axis], FORCE_FLOOR_M_S2 * FORCE_FLOOR_M_S2) * span_s / dt_s
            rate_var[axis] = max(body.noise.rate_rad2_s2[axis], least_rate_var) * span_s / dt_s
            if not measured:
                force_error_m_s2 = MODELLED_FORCE_M_S2 if isfinite(modelled) else UNKNOWN_FORCE_M_S2
                force_var[axis] = force_error_m_s2 * force_error_m_s2 * MODELLED_CORRELATION_S / dt_s
            if not known:
                rate[axis] = 0.0
                rate_var[axis] = UNKNOWN_RATE_RAD_S * UNKNOWN_RATE_RAD_S
        body.status.gap |= not known
        gain_m_s2 = 0.0 if measured or not isfinite(modelled) else modelled
        predict(x, force, force_var, rate, rate_var, gain_m_s2, dt_s, response)
        x.t_ns = end_ns
        if measured and whole and isfinite(modelled):
            use_thrust(body, force, modelled, bank, i)
        if whole:
            number += 1


@kernel
def begin(body: Body, t_ns: int, pos_lab_m: Float, q_lab_from_flu: Float) -> None:
    """Starts the estimate at a pose, its velocity unknown; what was learned slowly stays, as uncertain as it was."""
    x = body.estimate
    learned = np.empty(ERRORS)
    for k in range(ERRORS):
        learned[k] = x.cov[k, k]
    x.t_ns = t_ns
    copy_into(pos_lab_m, x.pos_lab_m)
    x.vel_lab_m_s[:] = 0.0
    copy_into(q_lab_from_flu, x.q_lab_from_flu)
    x.cov[:] = 0.0
    for i in range(3):
        x.cov[POS + i, POS + i] = body.noise.source[POSE_POSITION]
        x.cov[VEL + i, VEL + i] = FIRST_VEL_M_S * FIRST_VEL_M_S
        x.cov[ATT + i, ATT + i] = body.noise.source[POSE_ATTITUDE]
        x.cov[BIAS + i, BIAS + i] = learned[BIAS + i] or FIRST_BIAS_M_S2 * FIRST_BIAS_M_S2
        x.cov[LEVEL + i, LEVEL + i] = learned[LEVEL + i] or FIRST_LEVEL_RAD * FIRST_LEVEL_RAD
    x.cov[SCALE, SCALE] = learned[SCALE] or FIRST_SCALE * FIRST_SCALE
    x.cov[DELAY, DELAY] = learned[DELAY] or FIRST_DELAY_S * FIRST_DELAY_S
    x.cov[STAMP, STAMP] = STAMP_SCATTER_S * STAMP_SCATTER_S
    status = body.status
    status.begun, status.timed, status.rejecting_ns, status.consistent_ns = True, False, 0, 0


@kernel
def certain(motion: Float, mean_square: float) -> float:
    """The share of an estimated motion (3) that its error is not, at TEST_SIGMAS; mean_square: of the error.

    The rest shows no delay: a body that stands would teach the delay that its noise happens to fit.
    """
    error = TEST_SIGMAS * TEST_SIGMAS * mean_square
    square = motion[0] ** 2 + motion[1] ** 2 + motion[2] ** 2
    return sqrt(1.0 - error / square) if square > error else 0.0


@kernel
def _acceleration(x: Estimate, axis: int) -> float:
    """Along an axis of `lab`, m/s^2."""
    value: float = x.force_lab_m_s2[axis] - (GRAVITY_M_S2 if axis == 2 else 0.0)
    return value


@kernel
def _shown_vel_error(x: Estimate) -> float:
    """Mean square error of the velocity that a pose shows: of the velocity, and of when that was in an acceleration."""
    error = 0.0
    for axis in range(3):
        acc = _acceleration(x, axis)
        error += x.cov[VEL + axis, VEL + axis] + acc * acc * x.cov[DELAY, DELAY]
    return error


@kernel
def start_delay(body: Body) -> None:
    """From now on the estimate is of the stamps' time, before it was of what the poses showed: a delay earlier.

    The delay times an unknown velocity is no linear error; once the velocity is known it is.
    """
    x = body.estimate
    if x.cov[VEL, VEL] + x.cov[VEL + 1, VEL + 1] + x.cov[VEL + 2, VEL + 2] > TIMED_VEL_M_S * TIMED_VEL_M_S:
        return
    body.status.timed = True
    shift = np.zeros(ERRORS)
    certainty = certain(x.vel_lab_m_s, _shown_vel_error(x))
    for axis in range(3):
        shift[POS + axis] = certainty * x.vel_lab_m_s[axis]
    for i in range(ERRORS):
        for j in range(ERRORS):
            if i != DELAY and j != DELAY:
                x.cov[i, j] += shift[i] * shift[j] * x.cov[DELAY, DELAY]
    for i in range(ERRORS):
        if i != DELAY:
            x.cov[i, DELAY] += shift[i] * x.cov[DELAY, DELAY]
            x.cov[DELAY, i] = x.cov[i, DELAY]
    inject(x, x.pose_delay_s * shift)


@kernel
def use_pose(body: Body, t_ns: int, pos_lab_m: Float, q_lab_from_flu: Float, bank: Bank, i: int) -> None:
    """Predicts the estimate to a pose's stamp and corrects it, unless the poses are rejected or found to be faulty."""
    x, status = body.estimate, body.status
    if not status.begun:
        begin(body, t_ns, pos_lab_m, q_lab_from_flu)
        add_onset(bank, i, x)
        return
    coast(body, t_ns, bank, i)
    # Without an accelerometer the poses are all that shows the velocity, and no delay: there is nothing to wait for.
    if not status.timed and measures_force(body.inertial):
        start_delay(body)
        status.gap = True
    if status.gap:
        reset_onsets(bank, i)
        status.gap = False
    _new_stamp(body, bank, i)
    innovation, rows, variance = np.empty(6), np.zeros((6, ERRORS)), np.empty(6)
    _pose_rows(body, pos_lab_m, q_lab_from_flu, innovation, rows)
    p_h, correction = np.empty(ERRORS), np.zeros(ERRORS)
    for k in range(6):
        var = body.noise.source[POSE_POSITION if k < 3 else POSE_ATTITUDE]
        variance[k] = innovation_variance(x.cov, rows[k], var, p_h)
    last_ns = body.innovations.t_ns[POSE_POSITION]
    fused = status.rejecting_ns == 0
    consistent = record(body, POSE_POSITION, t_ns, pos_lab_m, innovation[:3], variance[:3], fused)
    consistent &= record(body, POSE_ATTITUDE, t_ns, q_lab_from_flu[1:], innovation[3:], variance[3:], fused)
    if not fused:
        _reacquire(body, t_ns, pos_lab_m, q_lab_from_flu, consistent, bank, i)
        return
    more = np.zeros(2)
    for k in range(6):
        source, axis = (POSE_POSITION, k) if k < 3 else (POSE_ATTITUDE, k - 3)
        more[source] += use(body, bank, i, source, axis, rows[k], innovation[k], correction) / 3.0
    inject(x, correction)
    if _judge(body, t_ns, bank, i):
        return
    add_onset(bank, i, x)
    for source in range(2):
        learn(body, source, more[source], (t_ns - last_ns) * 1e-9)


@kernel
def _new_stamp(body: Body, bank: Bank, i: int) -> None:
    """Nothing is known of what the next pose's stamp is off by, whatever the last one's was."""
    cov = body.estimate.cov
    for k in range(ERRORS):
        cov[STAMP, k] = cov[k, STAMP] = 0.0
    cov[STAMP, STAMP] = STAMP_SCATTER_S * STAMP_SCATTER_S
    bank.response[i, STAMP, :] = 0.0


@kernel
def _pose_rows(body: Body, pos_lab_m: Float, q_lab_from_flu: Float, innovation: Float, rows: Float) -> None:
    """Innovation (6) of a pose that shows the body as it was the delay ago, and its rows (6, errors).

    As much of the delay is in the innovation as in the rows: what a row leaves out, no correction could take back.
    """
    x, rate, shown_vel = body.estimate, np.empty(3), np.empty(3)
    delay_s = x.pose_delay_s if body.status.timed else 0.0
    q, shown = x.q_lab_from_flu, np.empty(4)
    rotate_into(q, x.rate_flu_rad_s, rate)
    rate_error, least = 0.0, 3.0 * RATE_FLOOR_RAD_S * RATE_FLOOR_RAD_S
    for axis in range(3):
        shown_vel[axis] = x.vel_lab_m_s[axis] - delay_s * _acceleration(x, axis)
        rate_error += body.noise.rate_rad2_s2[axis]
    moves, turns = 0.0, 0.0
    if body.status.timed:
        turns = certain(rate, max(rate_error, least))
        # Without an accelerometer the poses themselves are all that shows the velocity.
        moves = certain(shown_vel, _shown_vel_error(x)) if measures_force(body.inertial) else 0.0
    turn_into(q, -turns * delay_s * x.rate_flu_rad_s, shown)
    rotation_vector_into(q_lab_from_flu, shown, innovation[3:])
    late_s = moves * delay_s
    for axis in range(3):
        acc = _acceleration(x, axis)
        travelled_m = late_s * (x.vel_lab_m_s[axis] - 0.5 * late_s * acc)
        shown_vel[axis] = x.vel_lab_m_s[axis] - late_s * acc
        innovation[axis] = pos_lab_m[axis] - x.pos_lab_m[axis] + travelled_m
        rows[axis, POS + axis], rows[axis, VEL + axis], rows[axis, DELAY] = 1.0, -late_s, -moves * shown_vel[axis]
        rows[3 + axis, ATT + axis], rows[3 + axis, DELAY] = 1.0, -turns * rate[axis]
        rows[axis, STAMP], rows[3 + axis, STAMP] = -shown_vel[axis], -rate[axis]


@kernel
def _judge(body: Body, t_ns: int, bank: Bank, i: int) -> bool:
    """Whether poses are found to be faulty: then the estimate is as before the onset, and dead reckoning since."""
    x, fault = body.estimate, body.fault
    slot = find_fault(bank, i, t_ns, fault)
    if slot < 0:
        return False
    reset_onsets(bank, i)
    if not bank.shapes[fault.row].rolls_back:
        x.cov[SCALE, SCALE] += fault.amplitude[0] * fault.amplitude[0]
        return False
    copy_estimate(bank.onsets[i * ONSETS + slot].estimate, x)
    coast(body, t_ns, bank, i)
    body.status.gap = False
    body.status.rejecting_ns, body.status.consistent_ns = t_ns, 0
    for source in range(2):
        body.innovations.fused[source], body.innovations.rejected[source] = False, True
    return True


@kernel
def _reacquire(
    body: Body, t_ns: int, pos_lab_m: Float, q_lab_from_flu: Float, consistent: bool, bank: Bank, i: int
) -> None:
    """Poses that are consistent for REACQUIRE_NS are used from the next on; after ALONE_NS the estimate begins anew."""
    status = body.status
    if not consistent:
        status.consistent_ns = 0
    elif status.consistent_ns == 0:
        status.consistent_ns = t_ns
    if t_ns - status.rejecting_ns >= ALONE_NS:
        begin(body, t_ns, pos_lab_m, q_lab_from_flu)
    elif status.consistent_ns and t_ns - status.consistent_ns >= REACQUIRE_NS:
        status.rejecting_ns, status.consistent_ns = 0, 0
    if status.rejecting_ns == 0:
        reset_onsets(bank, i)
    _judge(body, t_ns, bank, i)  # what is no fault of the poses
    add_onset(bank, i, body.estimate)


@kernel
def _compare_attitude(body: Body, until_ns: int, bank: Bank, i: int) -> None:
    """Uses the autopilot's attitude that waits, if it is of that time or before."""
    pending = body.pending
    if 0 < pending.attitude_t_ns <= until_ns:
        if body.status.begun:
            use_attitude(body, pending.attitude_t_ns, pending.q_lab_from_flu_autopilot, bank, i)
        pending.attitude_t_ns = 0


@kernel
def advance(body: Body, bank: Bank, i: int) -> None:
    """Uses, in order, what inertial samples have passed since, and poses that have waited for LATEST_NS.

    The body rates until an observation are those measured then: a motor that fails spins it up within one sample.
    """
    pending, ring, x = body.pending, body.inertial, body.estimate
    newest_ns = ring.t_ns[(ring.count - 1) % SAMPLES] if ring.count > 0 else 0
    while pending.count > 0:
        t_ns, last_ns = pending.t_ns[0], pending.t_ns[pending.count - 1]
        silent = last_ns - max(newest_ns, 1) > LATEST_NS
        if t_ns > newest_ns and not silent and pending.count < PENDING:
            break
        _compare_attitude(body, t_ns, bank, i)
        use_pose(body, t_ns, pending.pos_lab_m[0].copy(), pending.q_lab_from_flu[0].copy(), bank, i)
        for k in range(1, pending.count):
            pending.t_ns[k - 1] = pending.t_ns[k]
            copy_into(pending.pos_lab_m[k], pending.pos_lab_m[k - 1])
            copy_into(pending.q_lab_from_flu[k], pending.q_lab_from_flu[k - 1])
        pending.count -= 1
    _compare_attitude(body, newest_ns, bank, i)
    if body.status.begun and pending.count == 0 and newest_ns - x.t_ns > LATEST_NS:
        coast(body, newest_ns - LATEST_NS, bank, i)

"""The simulated autopilot's Kalman filter: 15 error states, from inertial samples, positions and headings. No time.

After PX4's EKF2 (src/modules/ekf2/EKF): its process noises, an innovation limit for each observation, positions
observed against where the estimate was at their capture. Its errors are turned about lab axes: q_true = exp(e) q.
"""

from math import atan2, cos, sin, sqrt

import numpy as np

from formation.maths.arrays import Float
from formation.maths.copying import copy_into
from formation.maths.kernel import kernel
from formation.maths.quaternion import heading_of, matrix_into
from formation.vehicle.body import GRAVITY_M_S2

ATTITUDE, VEL, POS, RATE_BIAS, FORCE_BIAS = 0, 4, 7, 10, 13
"""In the estimate x (16): q_lab_from_flu, m/s and m in `lab`, rad/s and m/s^2 in `flu`."""
TILT_ERROR, VEL_ERROR, POS_ERROR, RATE_BIAS_ERROR, FORCE_BIAS_ERROR, ERRORS = 0, 3, 6, 9, 12, 15
"""In the covariance (15, 15)."""
HISTORY = 128
"""Past positions and headings (t_s, x, y, z, heading), one a sample: 0.64 s of 5 ms."""
_STEP_S = 0.01
"""EKF2 adds (noise * step)^2 a step of this length (FILTER_UPDATE_PERIOD)."""
_RATE_NOISE2, _FORCE_NOISE2 = 0.015**2 * _STEP_S, 0.35**2 * _STEP_S
"""Variances a second: EKF2_GYR_NOISE, rad/s, and EKF2_ACC_NOISE, m/s^2."""
_RATE_BIAS_NOISE2, _FORCE_BIAS_NOISE2 = 0.001**2 * _STEP_S, 0.003**2 * _STEP_S
"""Likewise: EKF2_GYR_B_NOISE, rad/s^2, and EKF2_ACC_B_NOISE, m/s^3."""
_TILT_FIRST, _HEADING_FIRST, _VEL_FIRST, _POS_FIRST = 0.1**2, 3.0**2, 0.5**2, 1.0**2
_RATE_BIAS_FIRST, _FORCE_BIAS_FIRST = 0.1**2 * 0.01, 0.2**2
"""EKF2_ANGERR_INIT; a heading that nobody knows; EKF2_GBIAS_INIT and EKF2_ABIAS_INIT."""


@kernel
def begin(x: Float, cov: Float, pos_lab_m: Float, heading_rad: float) -> None:
    """Level, at rest, at a place and heading, with the variances of a filter that has just begun."""
    x[:] = 0.0
    x[ATTITUDE], x[ATTITUDE + 3] = cos(0.5 * heading_rad), sin(0.5 * heading_rad)
    cov[:] = 0.0
    for axis in range(3):
        x[POS + axis] = pos_lab_m[axis]
        cov[TILT_ERROR + axis, TILT_ERROR + axis] = _TILT_FIRST if axis < 2 else _HEADING_FIRST
        cov[VEL_ERROR + axis, VEL_ERROR + axis] = _VEL_FIRST
        cov[POS_ERROR + axis, POS_ERROR + axis] = _POS_FIRST
        cov[RATE_BIAS_ERROR + axis, RATE_BIAS_ERROR + axis] = _RATE_BIAS_FIRST
        cov[FORCE_BIAS_ERROR + axis, FORCE_BIAS_ERROR + axis] = _FORCE_BIAS_FIRST


@kernel
def _turn(q: Float, x_rad: float, y_rad: float, z_rad: float, in_lab: bool) -> None:
    """Turn an attitude by a small rotation vector, in `lab` axes or the body's, in place."""
    w, i, j, k = 1.0, 0.5 * x_rad, 0.5 * y_rad, 0.5 * z_rad
    a, b, c, d = q[0], q[1], q[2], q[3]
    s = 1.0 if in_lab else -1.0
    q[0] = w * a - i * b - j * c - k * d
    q[1] = w * b + i * a + s * (j * d - k * c)
    q[2] = w * c + j * a + s * (k * b - i * d)
    q[3] = w * d + k * a + s * (i * c - j * b)
    norm = sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    for n in range(4):
        q[n] /= norm


@kernel
def predict(
    x: Float, cov: Float, sample: Float, t_s: float, dt_s: float, history: Float, row: int, climbed: Float, rate: Float
) -> None:
    """Advance by one inertial sample (6): mean specific force, m/s^2, and rate, rad/s, in `flu`, over dt_s until t_s.

    history: its row `row` is overwritten. climbed (1): grows by what the sensors alone make of the climb, m/s.
    rate (3): becomes the body's, rad/s.
    """
    r = np.empty((3, 3))
    matrix_into(x[ATTITUDE : ATTITUDE + 4], r)
    turn, force = np.empty(3), np.empty(3)
    for axis in range(3):
        rate[axis] = sample[3 + axis] - x[RATE_BIAS + axis]
        turn[axis] = rate[axis] * dt_s
    # The mean force is in the axes of half-way.
    q = x[ATTITUDE : ATTITUDE + 4]
    for axis in range(3):
        force[axis] = 0.0
        for n in range(3):
            force[axis] += r[axis, n] * (sample[n] - x[FORCE_BIAS + n])
    half = np.empty(3)
    for axis in range(3):
        half[axis] = 0.5 * (r[axis, 0] * turn[0] + r[axis, 1] * turn[1] + r[axis, 2] * turn[2])
    fx, fy, fz = force[0], force[1], force[2]
    force[0] += half[1] * fz - half[2] * fy
    force[1] += half[2] * fx - half[0] * fz
    force[2] += half[0] * fy - half[1] * fx
    for axis in range(3):
        gain = (force[axis] - (GRAVITY_M_S2 if axis == 2 else 0.0)) * dt_s
        x[POS + axis] += (x[VEL + axis] + 0.5 * gain) * dt_s
        x[VEL + axis] += gain
    climbed[0] += (force[2] - GRAVITY_M_S2) * dt_s
    _turn(q, turn[0], turn[1], turn[2], False)
    _advance_covariance(cov, r, force, dt_s)
    history[row, 0], history[row, 4] = t_s, heading_of(x)
    for axis in range(3):
        history[row, 1 + axis] = x[POS + axis]


@kernel
def _advance_covariance(cov: Float, r: Float, force: Float, dt_s: float) -> None:
    """F P F^T + Q with F = 1 + A dt, of which only the blocks that are not zero are multiplied."""
    _advance_rows(cov, r, force, dt_s)
    _advance_rows(cov.T, r, force, dt_s)
    for axis in range(3):
        cov[TILT_ERROR + axis, TILT_ERROR + axis] += _RATE_NOISE2 * dt_s
        cov[VEL_ERROR + axis, VEL_ERROR + axis] += _FORCE_NOISE2 * dt_s
        cov[RATE_BIAS_ERROR + axis, RATE_BIAS_ERROR + axis] += _RATE_BIAS_NOISE2 * dt_s
        cov[FORCE_BIAS_ERROR + axis, FORCE_BIAS_ERROR + axis] += _FORCE_BIAS_NOISE2 * dt_s


@kernel
def _advance_rows(m: Float, r: Float, force: Float, dt_s: float) -> None:
    """F m, in place."""
    for n in range(ERRORS):
        tx, ty, tz = m[0, n], m[1, n], m[2, n]
        for axis in range(3):
            m[POS_ERROR + axis, n] += dt_s * m[VEL_ERROR + axis, n]
        for axis in range(3):
            turned, pushed = 0.0, 0.0
            for b in range(3):
                turned += r[axis, b] * m[RATE_BIAS_ERROR + b, n]
                pushed += r[axis, b] * m[FORCE_BIAS_ERROR + b, n]
            m[VEL_ERROR + axis, n] -= dt_s * pushed
            m[TILT_ERROR + axis, n] -= dt_s * turned
        m[VEL_ERROR, n] += dt_s * (ty * force[2] - tz * force[1])
        m[VEL_ERROR + 1, n] += dt_s * (tz * force[0] - tx * force[2])
        m[VEL_ERROR + 2, n] += dt_s * (tx * force[1] - ty * force[0])


@kernel
def _correct(x: Float, cov: Float, history: Float, error: int, innovation: float, variance: float) -> None:
    """Observe one error state: of `variance` itself."""
    total = cov[error, error] + variance
    gain, observed = np.empty(ERRORS), np.empty(ERRORS)
    for n in range(ERRORS):
        observed[n] = cov[error, n]
        gain[n] = cov[n, error] / total
    for n in range(ERRORS):
        for m in range(ERRORS):
            cov[n, m] -= gain[n] * observed[m]
    before = heading_of(x)
    _turn(x[ATTITUDE : ATTITUDE + 4], gain[0] * innovation, gain[1] * innovation, gain[2] * innovation, True)
    turned = heading_of(x) - before
    for axis in range(3):
        x[VEL + axis] += gain[VEL_ERROR + axis] * innovation
        x[POS + axis] += gain[POS_ERROR + axis] * innovation
        x[RATE_BIAS + axis] += gain[RATE_BIAS_ERROR + axis] * innovation
        x[FORCE_BIAS + axis] += gain[FORCE_BIAS_ERROR + axis] * innovation
    # What the past was is corrected with the present: the next observation of it is not surprised anew.
    for row in range(len(history)):
        history[row, 4] += turned
        for axis in range(3):
            history[row, 1 + axis] += gain[POS_ERROR + axis] * innovation


@kernel
def _past(x: Float, history: Float, t_s: float, row: int, was: Float) -> bool:
    """Position and heading (4) at t_s, between the two samples about it; False where it lies before all of them."""
    newer = row
    copy_into(history[newer, 1:5], was)
    if t_s >= history[newer, 0]:
        for n in range(3):
            was[n] += (t_s - history[newer, 0]) * x[VEL + n]
        return True
    for _ in range(len(history)):
        older = (newer - 1) % len(history)
        if history[older, 0] >= history[newer, 0]:
            return False
        if t_s >= history[older, 0]:
            share = (t_s - history[older, 0]) / (history[newer, 0] - history[older, 0])
            for n in range(3):
                was[n] = history[older, 1 + n] + share * (history[newer, 1 + n] - history[older, 1 + n])
            was[3] = history[newer, 4]
            return True
        newer = older
    return False


@kernel
def observe_pose(
    x: Float, cov: Float, history: Float, row: int, t_s: float, pose: Float, noise: Float, ratios: Float
) -> None:
    """Observe a position and heading (4) captured at t_s, each group as far as it is within its limit.

    noise (4): standard deviations of position, m, and heading, rad, and the limits of both in standard deviations.
    ratios (3): the test ratios of position in the plane, height and heading; above 1: rejected. NaN: too old.
    """
    was = np.empty(4)
    if not _past(x, history, t_s, row, was):
        ratios[:] = np.nan
        return
    for axis in range(3):
        innovation = pose[axis] - was[axis]
        total = cov[POS_ERROR + axis, POS_ERROR + axis] + noise[0] * noise[0]
        ratio = innovation * innovation / (noise[2] * noise[2] * total)
        group = 0 if axis < 2 else 1
        ratios[group] = max(ratios[0], ratio) if axis == 1 else ratio
    turn = pose[3] - was[3]
    turn = atan2(sin(turn), cos(turn))
    total = cov[TILT_ERROR + 2, TILT_ERROR + 2] + noise[1] * noise[1]
    ratios[2] = turn * turn / (noise[3] * noise[3] * total)
    for axis in range(3):
        # An earlier axis has moved the present and the past alike.
        innovation = pose[axis] - was[axis]
        if ratios[0 if axis < 2 else 1] <= 1.0:
            _correct(x, cov, history, POS_ERROR + axis, innovation, noise[0] * noise[0])
            _past(x, history, t_s, row, was)
    if ratios[2] <= 1.0:
        _correct(x, cov, history, TILT_ERROR + 2, turn, noise[1] * noise[1])


@kernel
def observe_rest(x: Float, cov: Float, history: Float, deviation_m_s: float) -> None:
    """It stands: observe a velocity of zero (EKF2's zero velocity update)."""
    for axis in range(3):
        _correct(x, cov, history, VEL_ERROR + axis, -x[VEL + axis], deviation_m_s * deviation_m_s)


@kernel
def reset_position(x: Float, cov: Float, history: Float, pos_m: Float, variance: float, first: int, last: int) -> None:
    """Take axes first..last of a position for the present one, as EKF2 does after too long a rejection."""
    for axis in range(first, last):
        shift = pos_m[axis] - x[POS + axis]
        x[POS + axis] += shift
        for row in range(len(history)):
            history[row, 1 + axis] += shift
        error = POS_ERROR + axis
        cov[error, :] = 0.0
        cov[:, error] = 0.0
        cov[error, error] = variance


@kernel
def reset_heading(x: Float, cov: Float, history: Float, heading_rad: float, variance: float) -> None:
    """Take a heading for the present one; velocity and tilt turn with it."""
    turn = heading_rad - heading_of(x)
    a, b, c, d = x[0], x[1], x[2], x[3]
    w, k = cos(0.5 * turn), sin(0.5 * turn)
    x[0], x[1], x[2], x[3] = w * a - k * d, w * b - k * c, w * c + k * b, w * d + k * a
    vx, vy = x[VEL], x[VEL + 1]
    x[VEL], x[VEL + 1] = cos(turn) * vx - sin(turn) * vy, sin(turn) * vx + cos(turn) * vy
    for row in range(len(history)):
        history[row, 4] += turn
    error = TILT_ERROR + 2
    cov[error, :] = 0.0
    cov[:, error] = 0.0
    cov[error, error] = variance

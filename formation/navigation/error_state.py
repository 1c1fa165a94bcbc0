"""The error-state Kalman filter: prediction by one inertial sample, and the scalar update that every source uses.

    pos += dt v + dt^2/2 a,  v += dt a,  a = R (f - bias) - g,  R = R exp(dt rate)
    P = F P F' + Q,  k = P h / s,  s = h' P h + r,  P -= k k' s

A vector is used one scalar after the other, so that the innovations are white across its axes as they are in time
(Bierman 1977). What a fault of a source does to the error state (`response`) obeys the same F and k.
"""

import numpy as np

from formation.maths.arrays import Float
from formation.maths.copying import copy_into
from formation.maths.kernel import kernel
from formation.maths.quaternion import matrix_into, multiply_into, rotate_into, rotation_vector_of, turn_into
from formation.navigation.state import ATT, BIAS, DELAY, ERRORS, LEVEL, POS, SCALE, VEL, Estimate
from formation.vehicle.body import GRAVITY_M_S2

BIAS_WALK = 0.01
"""Random walk of the accelerometer's bias, m/s^2 per root second: half a degree of level in 80 s."""
LEVEL_WALK = 0.008
"""Of the level bias, rad per root second: 0.5 degrees RMS, correlated over 2.5 s, as measured of PX4 in SIH."""
SCALE_WALK, MODELLED_SCALE_WALK = 0.02, 0.1
"""Of the thrust scale, 1 per root second: a battery's sag is far slower, a gust along the thrust is not. Without an
accelerometer nothing else shows that commands are not followed: learned within half a second."""
DELAY_WALK = 0.001
"""Of the pose delay, s per root second: what TIMESYNC's filter lets clocks wander."""


@kernel
def rotation_vector_into(q_b: Float, q_a: Float, out: Float) -> None:
    """The rotation vector of q_b q_a^-1, rad, in the axes both turn into."""
    q, inverse = np.empty(4), np.empty(4)
    inverse[0], inverse[1], inverse[2], inverse[3] = q_a[0], -q_a[1], -q_a[2], -q_a[3]
    multiply_into(q_b, inverse, q)
    rotation_vector_of(q, out)


@kernel
def turn_lab(q: Float, rotation_lab_rad: Float) -> None:
    """q = exp(rotation) q, in place."""
    rotation_flu, inverse, out = np.empty(3), np.empty(4), np.empty(4)
    inverse[0], inverse[1], inverse[2], inverse[3] = q[0], -q[1], -q[2], -q[3]
    rotate_into(inverse, rotation_lab_rad, rotation_flu)
    turn_into(q, rotation_flu, out)
    copy_into(out, q)


@kernel
def move(x: Estimate, force_flu_m_s2: Float, rate_flu_rad_s: Float, dt_s: float, r: Float) -> None:
    """Moves position, velocity and attitude on by dt_s; the matrix of half-way into r (3, 3)."""
    force_flu, turned = np.empty(3), np.empty(4)
    turn_into(x.q_lab_from_flu, 0.5 * dt_s * rate_flu_rad_s, turned)
    matrix_into(turned, r)
    for axis in range(3):
        force_flu[axis] = force_flu_m_s2[axis] - x.accel_bias_flu_m_s2[axis]
    rotate_into(turned, force_flu, x.force_lab_m_s2)
    for axis in range(3):
        gained = dt_s * (x.force_lab_m_s2[axis] - (GRAVITY_M_S2 if axis == 2 else 0.0))
        x.pos_lab_m[axis] += dt_s * (x.vel_lab_m_s[axis] + 0.5 * gained)
        x.vel_lab_m_s[axis] += gained
    turn_into(x.q_lab_from_flu, dt_s * rate_flu_rad_s, turned)
    copy_into(turned, x.q_lab_from_flu)
    copy_into(rate_flu_rad_s, x.rate_flu_rad_s)


@kernel
def predict(
    x: Estimate, force_flu_m_s2: Float, force_var: Float, rate_flu_rad_s: Float, rate_var: Float, modelled_m_s2: float,
    dt_s: float, response: Float,
) -> None:  # fmt: skip
    """Advances the estimate by dt_s, in which specific force and rate stand; and `response` (columns of error states).

    force_var, rate_var (3): of the means over dt_s. modelled_m_s2: the thrust the force was modelled by, 0: measured.
    """
    r, cov = np.empty((3, 3)), x.cov
    move(x, force_flu_m_s2, rate_flu_rad_s, dt_s, r)
    step = _step(r, x.force_lab_m_s2, modelled_m_s2, dt_s)
    transition(cov, step, dt_s)
    transition(cov.T, step, dt_s)
    _add_noise(cov, r, force_var, rate_var, SCALE_WALK if modelled_m_s2 == 0.0 else MODELLED_SCALE_WALK, dt_s)
    transition(response, step, dt_s)


@kernel
def _step(r: Float, force_lab: Float, modelled_m_s2: float, dt_s: float) -> Float:
    """What an error of attitude, bias and thrust scale (7 columns) makes of the velocity (rows) in dt_s."""
    step = np.zeros((3, 7))
    x, y, z = force_lab[0], force_lab[1], force_lab[2]
    step[0, 1], step[0, 2] = dt_s * z, -dt_s * y
    step[1, 0], step[1, 2] = -dt_s * z, dt_s * x
    step[2, 0], step[2, 1] = dt_s * y, -dt_s * x
    for i in range(3):
        for j in range(3):
            step[i, 3 + j] = -dt_s * r[i, j]
        step[i, 6] = dt_s * r[i, 2] * modelled_m_s2
    return step


@kernel
def transition(errors: Float, step: Float, dt_s: float) -> None:
    """errors = F errors, in place; each column (errors, k) is one error state. Along the rows, which lie in a row."""
    for i in range(3):
        for k in range(errors.shape[1]):
            gained = step[i, 6] * errors[SCALE, k]
            for j in range(3):
                gained += step[i, j] * errors[ATT + j, k] + step[i, 3 + j] * errors[BIAS + j, k]
            errors[POS + i, k] += dt_s * (errors[VEL + i, k] + 0.5 * gained)
            errors[VEL + i, k] += gained


@kernel
def _add_noise(cov: Float, r: Float, force_var: Float, rate_var: Float, scale_walk: float, dt_s: float) -> None:
    """Adds Q, and makes the covariance exactly symmetric."""
    square = dt_s * dt_s
    for i in range(3):
        for j in range(3):
            force, rate = 0.0, 0.0
            for k in range(3):
                force += r[i, k] * r[j, k] * force_var[k]
                rate += r[i, k] * r[j, k] * rate_var[k]
            cov[VEL + i, VEL + j] += square * force
            cov[POS + i, POS + j] += 0.25 * square * square * force
            cov[POS + i, VEL + j] += 0.5 * square * dt_s * force
            cov[VEL + i, POS + j] += 0.5 * square * dt_s * force
            cov[ATT + i, ATT + j] += square * rate
        cov[BIAS + i, BIAS + i] += BIAS_WALK * BIAS_WALK * dt_s
        cov[LEVEL + i, LEVEL + i] += LEVEL_WALK * LEVEL_WALK * dt_s
    cov[SCALE, SCALE] += scale_walk * scale_walk * dt_s
    cov[DELAY, DELAY] += DELAY_WALK * DELAY_WALK * dt_s
    for i in range(ERRORS):
        for j in range(i):
            cov[i, j] = cov[j, i]


@kernel
def innovation_variance(cov: Float, h: Float, var: float, p_h: Float) -> float:
    """s = h' P h + var; P h into p_h. Few of h are not zero: the others are left out."""
    p_h[:] = 0.0
    for j in range(ERRORS):
        if h[j] != 0.0:
            for i in range(ERRORS):
                p_h[i] += cov[i, j] * h[j]
    total = var
    for i in range(ERRORS):
        if h[i] != 0.0:
            total += h[i] * p_h[i]
    return total


@kernel
def update(cov: Float, p_h: Float, variance: float, innovation: float, correction: Float, gain: Float) -> None:
    """Uses one scalar: covariance and correction (of the error state) after it, and the gain it was used with."""
    for i in range(ERRORS):
        gain[i] = p_h[i] / variance
        correction[i] += gain[i] * innovation
        for j in range(ERRORS):
            cov[i, j] -= p_h[i] * p_h[j] / variance


@kernel
def inject(x: Estimate, correction: Float) -> None:
    """Moves the estimated error into the estimate."""
    for axis in range(3):
        x.pos_lab_m[axis] += correction[POS + axis]
        x.vel_lab_m_s[axis] += correction[VEL + axis]
        x.accel_bias_flu_m_s2[axis] += correction[BIAS + axis]
        x.level_bias_flu_rad[axis] += correction[LEVEL + axis]
    turn_lab(x.q_lab_from_flu, correction[ATT : ATT + 3])
    x.thrust_scale += correction[SCALE]
    x.pose_delay_s += correction[DELAY]

"""One observation of a source: its normalised innovation recorded, used, and its noise learned."""

from math import exp

import numpy as np

from formation.maths.arrays import Float
from formation.maths.copying import copy_into
from formation.maths.kernel import kernel
from formation.maths.quaternion import matrix_into, turn_into
from formation.navigation.error_state import inject, innovation_variance, rotation_vector_into, update
from formation.navigation.evidence import Bank, add_evidence
from formation.navigation.samples import attitude_at
from formation.navigation.state import (
    ATT,
    AUTOPILOT_ATTITUDE,
    BIAS,
    ERRORS,
    LEVEL,
    POSE_ATTITUDE,
    POSE_POSITION,
    SCALE,
    THRUST,
    Body,
)

TEST_SIGMAS = 3.0
"""Of the innovation test. Poses are used again when within it; outliers of other sources, and of noise, count as this.
"""
UPRIGHT_LEAST = 0.5
"""Cosine of the tilt: at more than 60 degrees hardly anything of a horizontal wind is across the rotors' axis."""
SOURCE_LEARN_S = 3.0
"""Time constant of a source's learned noise: a camera's stays as it is."""


@kernel
def source_floor(source: int) -> float:
    """The least variance of a source: 0.2 mm, 0.3 mrad, 1 mrad, 0.2 m/s^2, squared.

    A camera's noise may be less, but not what markers that bend and samples that are held between make of a position.
    """
    if source == POSE_POSITION:
        return 4e-8
    if source == POSE_ATTITUDE:
        return 9e-8
    return 1e-6 if source == AUTOPILOT_ATTITUDE else 0.04


@kernel
def record(
    body: Body, source: int, t_ns: int, observation: Float, innovation: Float, variance: Float, fused: bool
) -> bool:
    """Notes the innovation (3) of a source; whether it is consistent along every axis."""
    out, consistent = body.innovations, True
    out.t_ns[source] = t_ns
    copy_into(observation, out.observation[source])
    copy_into(innovation, out.innovation[source])
    copy_into(variance, out.innovation_variance[source])
    for axis in range(3):
        ratio = 0.0
        if variance[axis] > 0.0:
            ratio = innovation[axis] * innovation[axis] / (TEST_SIGMAS * TEST_SIGMAS * variance[axis])
        out.test_ratio[source, axis] = ratio
        consistent &= ratio <= 1.0
    out.fused[source], out.rejected[source] = fused, not fused
    return consistent


@kernel
def use(
    body: Body, bank: Bank, i: int, source: int, axis: int, h: Float, innovation: float, correction: Float
) -> float:
    """Uses one scalar; by what share its squared innovation is more than its variance, bounded."""
    x, var = body.estimate, body.noise.source[source]
    p_h, gain = np.empty(ERRORS), np.empty(ERRORS)
    variance = innovation_variance(x.cov, h, var, p_h)
    white = innovation
    for k in range(ERRORS):
        white -= h[k] * correction[k]
    if source != POSE_POSITION and source != POSE_ATTITUDE:  # poses are judged by the signature table
        variance = max(variance, white * white / (TEST_SIGMAS * TEST_SIGMAS))
    update(x.cov, p_h, variance, white, correction, gain)
    add_evidence(bank, i, x.t_ns, source, axis, h, white, variance, gain)
    return float(min(white * white / variance, TEST_SIGMAS * TEST_SIGMAS) - 1.0)


@kernel
def learn(body: Body, source: int, more: float, dt_s: float) -> None:
    """Moves a source's variance to where its normalised innovations have variance 1."""
    share = 1.0 - exp(-min(dt_s, SOURCE_LEARN_S) / SOURCE_LEARN_S)
    body.noise.source[source] = max(body.noise.source[source] * (1.0 + share * more), source_floor(source))


@kernel
def use_thrust(body: Body, force_flu_m_s2: Float, modelled_m_s2: float, bank: Bank, i: int) -> None:
    """Compares the force measured along the rotors' axis, less that of a horizontal wind, with the modelled thrust.

    Rotors push along z alone: what is measured along x and y is air. A horizontal wind's force a obeys up' a = 0, so
    its part along z follows: a_z = -(up_x a_x + up_y a_y) / up_z. A lost thrust has no part along x and y.
    """
    x, r = body.estimate, np.empty((3, 3))
    h, p_h, correction = np.zeros(ERRORS), np.empty(ERRORS), np.zeros(ERRORS)
    observation, innovation, variance = np.zeros(3), np.zeros(3), np.zeros(3)
    matrix_into(x.q_lab_from_flu, r)
    h[BIAS + 2], h[SCALE] = 1.0, modelled_m_s2
    observation[2] = force_flu_m_s2[2]
    innovation[2] = force_flu_m_s2[2] - x.accel_bias_flu_m_s2[2] - x.thrust_scale * modelled_m_s2
    for axis in range(2):
        slope = r[2, axis] / max(r[2, 2], UPRIGHT_LEAST)
        h[BIAS + axis] = slope
        innovation[2] += slope * (force_flu_m_s2[axis] - x.accel_bias_flu_m_s2[axis])
    variance[2] = innovation_variance(x.cov, h, body.noise.source[THRUST], p_h)
    dt_s = (x.t_ns - body.innovations.t_ns[THRUST]) * 1e-9
    record(body, THRUST, x.t_ns, observation, innovation, variance, True)
    more = use(body, bank, i, THRUST, 2, h, innovation[2], correction)
    inject(x, correction)
    learn(body, THRUST, more, dt_s)


@kernel
def use_attitude(body: Body, t_ns: int, q_lab_from_flu: Float, bank: Bank, i: int) -> None:
    """Compares the autopilot's attitude with the one predicted for its time: what differs lastingly is level bias."""
    x, r = body.estimate, np.empty((3, 3))
    q, biased, innovation, variance = np.empty(4), np.empty(4), np.empty(3), np.empty(3)
    correction, p_h, rows = np.zeros(ERRORS), np.empty(ERRORS), np.zeros((3, ERRORS))
    attitude_at(x, body.inertial, t_ns, q)
    turn_into(q, x.level_bias_flu_rad, biased)
    matrix_into(biased, r)
    rotation_vector_into(q_lab_from_flu, biased, innovation)
    for axis in range(3):
        rows[axis, ATT + axis] = 1.0
        copy_into(r[axis], rows[axis, LEVEL : LEVEL + 3])
        variance[axis] = innovation_variance(x.cov, rows[axis], body.noise.source[AUTOPILOT_ATTITUDE], p_h)
    dt_s = (t_ns - body.innovations.t_ns[AUTOPILOT_ATTITUDE]) * 1e-9
    record(body, AUTOPILOT_ATTITUDE, t_ns, q_lab_from_flu[1:], innovation, variance, True)
    more = 0.0
    for axis in range(3):
        more += use(body, bank, i, AUTOPILOT_ATTITUDE, axis, rows[axis], innovation[axis], correction) / 3.0
    inject(x, correction)
    learn(body, AUTOPILOT_ATTITUDE, more, dt_s)

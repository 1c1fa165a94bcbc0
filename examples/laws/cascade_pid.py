"""Cascade PID: position asks for a velocity, velocity for an acceleration, an integral takes what is left over.

The double-loop PID of PX4's and most autopilots' position control (docs.px4.io, controller diagrams); the paper's
leader flies one, too.
"""

import numpy as np

from formation.maths.arrays import Vec3
from formation.own_law.law import Situation


class CascadePID:
    """kp_1_s: of the position; kd_1_s: of the velocity; ki_1_s2: of the integral of the velocity's error."""

    def __init__(self, kp_1_s: float = 2.0, kd_1_s: float = 5.0, ki_1_s2: float = 4.0) -> None:
        self._kp, self._kd, self._ki = kp_1_s, kd_1_s, ki_1_s2
        self._integral_m: Vec3 = np.zeros(3)

    def __call__(self, at: Situation) -> Vec3:
        """The acceleration demanded in `lab`, m/s^2."""
        wanted_m_s = at.slot.vel_lab_m_s - self._kp * (at.own.pos_lab_m - at.slot.pos_lab_m)
        error_m_s = at.own.vel_lab_m_s - wanted_m_s
        if not at.saturated:
            self._integral_m = self._integral_m + at.dt_s * error_m_s
        return at.slot.acc_lab_m_s2 - self._kd * error_m_s - self._ki * self._integral_m

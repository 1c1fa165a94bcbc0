"""L1 adaptive control: Hovakimyan, Cao, "L1 Adaptive Control Theory" (SIAM 2010), with the piecewise-constant law as on
quadrotors in Wu et al., "L1 quad" (2025), and as Neural-Fly's baseline has it.

A predictor of the velocity is driven by demand and estimate; its error at each step makes the next estimate; a low pass
decides how fast that is taken out. No observer of the program is used.
"""

from math import exp

import numpy as np

from formation.maths.arrays import Vec3
from formation.own_law.law import Situation


class L1:
    """kx_1_s2, kv_1_s: of the baseline; a_1_s: of the predictor; filter_rad_s: of what is taken out."""

    def __init__(
        self, kx_1_s2: float = 12.0, kv_1_s: float = 6.0, a_1_s: float = 10.0, filter_rad_s: float = 5.0
    ) -> None:
        self._kx, self._kv, self._a, self._filter_rad_s = kx_1_s2, kv_1_s, a_1_s, filter_rad_s
        self._predicted_m_s: Vec3 | None = None
        self._answered, self._sigma, self._removed = np.zeros(3), np.zeros(3), np.zeros(3)
        self._demanded: Vec3 = np.zeros(3)

    def __call__(self, at: Situation) -> Vec3:
        """The acceleration demanded in `lab`, m/s^2."""
        baseline = (
            at.slot.acc_lab_m_s2
            - self._kx * (at.own.pos_lab_m - at.slot.pos_lab_m)
            - self._kv * (at.own.vel_lab_m_s - at.slot.vel_lab_m_s)
        )
        if self._predicted_m_s is None:
            self._predicted_m_s = at.own.vel_lab_m_s.copy()
        if at.dt_s > 0.0:
            self._answered += (1.0 - exp(-at.dt_s / at.lag_s[0])) * (self._demanded - self._answered)
            error = self._predicted_m_s - at.own.vel_lab_m_s
            decay = exp(-self._a * at.dt_s)
            self._sigma = -self._a * decay / (1.0 - decay) * error
            self._predicted_m_s = self._predicted_m_s + at.dt_s * (self._answered + self._sigma - self._a * error)
            self._removed += (1.0 - exp(-self._filter_rad_s * at.dt_s)) * (self._sigma - self._removed)
        self._demanded = baseline - self._removed
        return self._demanded

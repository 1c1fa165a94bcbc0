"""The paper's composite law, ISTSMC with the observer's disturbance taken out (Ye et al. 2024, Eq. 7), gains for lag.

sig is rounded off near 0, s (s^2 + d^2)^(eps / 2), so that noise alone does not meet an infinite gain.
"""

import numpy as np

from formation.maths.arrays import Vec3
from formation.own_law.law import Situation


class Composite:
    """c_1_s, p1, p2, eps: of Eqs. (5) and (6); smooth_m_s: d, below which the power is rounded off."""

    def __init__(
        self, c_1_s: float = 4.0, p1: float = 4.1, p2: float = 0.6, eps: float = -0.18, smooth_m_s: float = 0.03
    ) -> None:
        self._c, self._p1, self._p2, self._eps, self._smooth = c_1_s, p1, p2, eps, smooth_m_s
        self._z_m: Vec3 = np.zeros(3)

    def _sig(self, s: Vec3, power: float) -> Vec3:
        return s * (s**2 + self._smooth**2) ** (0.5 * (power - 1.0))

    def __call__(self, at: Situation) -> Vec3:
        """The acceleration demanded in `lab`, m/s^2."""
        off_m = at.own.pos_lab_m - at.slot.pos_lab_m
        fast_m_s = at.own.vel_lab_m_s - at.slot.vel_lab_m_s
        s = self._c * off_m + fast_m_s
        if not at.saturated:
            self._z_m = self._z_m + at.dt_s * self._p2 * self._sig(s, 1.0 + 2.0 * self._eps)
        t_m = self._p1 * self._sig(s, 1.0 + self._eps) + self._z_m
        return at.slot.acc_lab_m_s2 - self._c * fast_m_s - t_m - at.disturbance_lab_m_s2

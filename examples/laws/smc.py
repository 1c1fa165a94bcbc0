"""The paper's baseline, sliding mode control: Ye et al., Machines 2024, 12(1), 32, Eq. (5) with t_m = k sign(s).

It knows no disturbance and chatters where the loop lags; gains as printed (Table 2).
"""

import numpy as np

from formation.maths.arrays import Vec3
from formation.own_law.law import Situation


class SMC:
    """c_1_s: of the error; k_m_s2: of the sign."""

    def __init__(self, c_1_s: float = 1.0, k_m_s2: float = 5.0) -> None:
        self._c, self._k = c_1_s, k_m_s2

    def __call__(self, at: Situation) -> Vec3:
        """The acceleration demanded in `lab`, m/s^2."""
        off_m = at.own.pos_lab_m - at.slot.pos_lab_m
        fast_m_s = at.own.vel_lab_m_s - at.slot.vel_lab_m_s
        s = self._c * off_m + fast_m_s
        return at.slot.acc_lab_m_s2 - self._c * fast_m_s - self._k * np.sign(s)

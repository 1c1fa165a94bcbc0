"""The paper's improved super-twisting law without its observer: Ye et al., Machines 2024, 12(1), 32, Eqs. (5)-(7).

t_m = p1 sig(s)^(1 + eps) + z_m, z_m' = p2 sig(s)^(1 + 2 eps), sig(x)^a = |x|^a sign(x); gains as printed (Table 2).
"""

import numpy as np

from formation.maths.arrays import Vec3
from formation.own_law.law import Situation


def sig(x: Vec3, power: float) -> Vec3:
    """|x|^power sign(x), elementwise."""
    return np.abs(x) ** power * np.sign(x)


class ISTSMC:
    """c_1_s, p1, p2, eps: of Eqs. (5) and (6); observed: 1 takes out the observer's disturbance (Eq. 7), 0 does not."""

    def __init__(
        self, c_1_s: float = 1.0, p1: float = 8.0, p2: float = 0.1, eps: float = -0.49, observed: float = 0.0
    ) -> None:
        if not -0.5 < eps < 0.0:
            raise ValueError(f"eps = {eps}: Eq. (6) needs -0.5 < eps < 0")
        self._c, self._p1, self._p2, self._eps, self._observed = c_1_s, p1, p2, eps, observed
        self._z_m: Vec3 = np.zeros(3)

    def __call__(self, at: Situation) -> Vec3:
        """The acceleration demanded in `lab`, m/s^2."""
        off_m = at.own.pos_lab_m - at.slot.pos_lab_m
        fast_m_s = at.own.vel_lab_m_s - at.slot.vel_lab_m_s
        s = self._c * off_m + fast_m_s
        if not at.saturated:
            self._z_m = self._z_m + at.dt_s * self._p2 * sig(s, 1.0 + 2.0 * self._eps)
        t_m = self._p1 * sig(s, 1.0 + self._eps) + self._z_m
        return at.slot.acc_lab_m_s2 - self._c * fast_m_s - t_m - self._observed * at.disturbance_lab_m_s2

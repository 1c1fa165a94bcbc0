"""Geometric tracking control on SE(3): Lee, Leok, McClamroch, CDC 2010, Eq. (19), with the integral of Goodarzi, Lee,
Lee, ECC 2013. Its attitude part is the autopilot's; the force is what is commanded here.
"""

import numpy as np

from formation.maths.arrays import Vec3
from formation.own_law.law import Situation


class Geometric:
    """kx_1_s2, kv_1_s, ki_1_s2: over mass; mix_1_s: c of the integral of v + c x, which is bounded by bound_m."""

    def __init__(
        self,
        kx_1_s2: float = 12.0,
        kv_1_s: float = 6.0,
        ki_1_s2: float = 4.0,
        mix_1_s: float = 1.5,
        bound_m: float = 1.0,
    ) -> None:
        self._kx, self._kv, self._ki, self._mix, self._bound_m = kx_1_s2, kv_1_s, ki_1_s2, mix_1_s, bound_m
        self._integral_m: Vec3 = np.zeros(3)

    def __call__(self, at: Situation) -> Vec3:
        """The acceleration demanded in `lab`, m/s^2."""
        ex_m = at.own.pos_lab_m - at.slot.pos_lab_m
        ev_m_s = at.own.vel_lab_m_s - at.slot.vel_lab_m_s
        grown = self._integral_m + at.dt_s * (ev_m_s + self._mix * ex_m)
        self._integral_m = np.clip(grown, -self._bound_m, self._bound_m)
        return at.slot.acc_lab_m_s2 - self._kx * ex_m - self._kv * ev_m_s - self._ki * self._integral_m

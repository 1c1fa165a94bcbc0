"""A lab's own control law: a cascade of position and velocity, and an integral of what it leaves over."""

import numpy as np
from numpy.typing import NDArray

from formation.own_law.law import Situation

Array = NDArray[np.float64]


class Cascade:
    """One follower's law: the place off its slot asks for a velocity, the velocity off that for an acceleration.

    kp_1_s: of the position; kd_1_s: of the velocity; ki_1_s2: of the integral of the velocity error, which the
    observer's disturbance, where it is used, leaves little to do; speed_m_s: the highest that a place off may ask for.
    """

    def __init__(
        self,
        kp_1_s: float = 1.6,
        kd_1_s: float = 4.0,
        ki_1_s2: float = 0.8,
        speed_m_s: float = 0.8,
        use_z3: bool = True,
    ) -> None:
        if min(kp_1_s, kd_1_s, speed_m_s) <= 0.0 or ki_1_s2 < 0.0:
            raise ValueError("kp_1_s, kd_1_s and speed_m_s must be positive, ki_1_s2 not negative")
        self._kp_1_s, self._kd_1_s, self._ki_1_s2 = kp_1_s, kd_1_s, ki_1_s2
        self._speed_m_s, self._use_z3 = speed_m_s, use_z3
        self._integral_m: Array = np.zeros(3)

    def __call__(self, at: Situation) -> Array:
        """The acceleration demanded in `lab`, m/s^2."""
        off_m = at.own.pos_lab_m - at.slot.pos_lab_m
        away_m = float(np.linalg.norm(off_m))
        back_m_s = -self._kp_1_s * off_m
        back_m_s *= min(1.0, self._speed_m_s / max(self._kp_1_s * away_m, 1e-9))
        too_fast_m_s = at.own.vel_lab_m_s - at.slot.vel_lab_m_s - back_m_s
        if not at.saturated:
            self._integral_m += at.dt_s * too_fast_m_s
        acc_lab_m_s2 = at.slot.acc_lab_m_s2 - self._kd_1_s * too_fast_m_s - self._ki_1_s2 * self._integral_m
        return acc_lab_m_s2 - at.disturbance_lab_m_s2 if self._use_z3 else acc_lab_m_s2

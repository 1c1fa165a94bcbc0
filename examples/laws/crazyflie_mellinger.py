"""The Crazyflie's Mellinger controller: Mellinger, Kumar, "Minimum snap trajectory generation and control for
quadrotors", ICRA 2011, with the gains, the integral and the mass of Bitcraze's firmware 2025.12.

Only its force is here; its attitude part is the autopilot's. Thrust is sent by a fixed number a newton, whatever the
battery gives.
"""

import numpy as np

from formation.maths.arrays import Vec3
from formation.own_law.law import Situation

GRAVITY_M_S2 = 9.81
MASS_KG, FULL_N = 0.029, 65535.0 / 132000.0


class CrazyflieMellinger:
    """kp_n_m, kd_n_s_m, ki_n_m_s: of x and y; kp_z_n_m and so on: of z; bound_m_s, bound_z_m_s: of the integrals."""

    full_thrust_m_s2 = FULL_N / MASS_KG
    """What it takes full thrust to accelerate at, where thrust is sent as a share of it."""

    def __init__(
        self, kp_n_m: float = 0.4, kd_n_s_m: float = 0.2, ki_n_m_s: float = 0.05, kp_z_n_m: float = 1.25,
        kd_z_n_s_m: float = 0.4, ki_z_n_m_s: float = 0.05, bound_m_s: float = 2.0, bound_z_m_s: float = 0.4,
    ) -> None:  # fmt: skip
        self._kp, self._kd, self._ki, self._bound_m_s = (
            np.array([xy, xy, z])
            for xy, z in ((kp_n_m, kp_z_n_m), (kd_n_s_m, kd_z_n_s_m), (ki_n_m_s, ki_z_n_m_s), (bound_m_s, bound_z_m_s))
        )
        self._integral_m_s: Vec3 = np.zeros(3)

    def __call__(self, at: Situation) -> Vec3:
        """The acceleration demanded in `lab`, m/s^2."""
        error_m = at.slot.pos_lab_m - at.own.pos_lab_m
        grown_m_s = self._integral_m_s + at.dt_s * error_m
        self._integral_m_s = np.clip(grown_m_s, -self._bound_m_s, self._bound_m_s)
        error_m_s = at.slot.vel_lab_m_s - at.own.vel_lab_m_s
        force_n = self._kp * error_m + self._kd * error_m_s + self._ki * self._integral_m_s
        demanded_m_s2: Vec3 = at.slot.acc_lab_m_s2 + force_n / MASS_KG
        return demanded_m_s2

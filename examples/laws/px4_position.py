"""PX4's position control in off-board mode: P of the position, PID of the velocity, tilt bounded before thrust.

docs.px4.io, controller diagrams; parameters MPC_* as v1.16 has them by default. The D acts on the measured velocity,
behind a low pass. Its autopilot estimates the hover thrust, so that a demand is an acceleration.
"""

from math import exp, tau

import numpy as np

from formation.maths.arrays import Vec3
from formation.own_law.law import Situation

GRAVITY_M_S2 = 9.80665


class PX4Position:
    """xy_p_1_s, z_p_1_s: MPC_XY_P, MPC_Z_P; the others: MPC_*_VEL_*_ACC, MPC_VELD_LP, MPC_TILTMAX_AIR."""

    def __init__(
        self, xy_p_1_s: float = 0.95, z_p_1_s: float = 1.0, xy_vel_p_1_s: float = 1.8, xy_vel_i_1_s2: float = 0.4,
        xy_vel_d: float = 0.2, z_vel_p_1_s: float = 4.0, z_vel_i_1_s2: float = 2.0, lowpass_hz: float = 5.0,
        tilt_deg: float = 45.0,
    ) -> None:  # fmt: skip
        self._p = np.array([xy_p_1_s, xy_p_1_s, z_p_1_s])
        self._vel_p = np.array([xy_vel_p_1_s, xy_vel_p_1_s, z_vel_p_1_s])
        self._vel_i = np.array([xy_vel_i_1_s2, xy_vel_i_1_s2, z_vel_i_1_s2])
        self._vel_d, self._lowpass_hz = np.array([xy_vel_d, xy_vel_d, 0.0]), lowpass_hz
        self._tan_most = float(np.tan(np.radians(tilt_deg)))
        self._integral_m_s2, self._acc_m_s2 = np.zeros(3), np.zeros(3)
        self._last_m_s: Vec3 | None = None

    def __call__(self, at: Situation) -> Vec3:
        """The acceleration demanded in `lab`, m/s^2."""
        error_m_s = at.slot.vel_lab_m_s + self._p * (at.slot.pos_lab_m - at.own.pos_lab_m) - at.own.vel_lab_m_s
        if self._last_m_s is not None and at.dt_s > 0.0:
            raw = (at.own.vel_lab_m_s - self._last_m_s) / at.dt_s
            self._acc_m_s2 += (1.0 - exp(-tau * self._lowpass_hz * at.dt_s)) * (raw - self._acc_m_s2)
        self._last_m_s = at.own.vel_lab_m_s.copy()
        wanted: Vec3 = (
            at.slot.acc_lab_m_s2 + self._vel_p * error_m_s + self._integral_m_s2 - self._vel_d * self._acc_m_s2
        )
        most = self._tan_most * (GRAVITY_M_S2 + wanted[2])
        sideways = float(np.hypot(wanted[0], wanted[1]))
        if sideways <= most:
            self._integral_m_s2 = self._integral_m_s2 + at.dt_s * self._vel_i * error_m_s
            return wanted
        self._integral_m_s2[2] += at.dt_s * self._vel_i[2] * error_m_s[2]
        return np.array([*(wanted[:2] * max(most, 0.0) / sideways), wanted[2]])

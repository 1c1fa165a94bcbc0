"""Incremental nonlinear dynamic inversion: Smeur, de Croon, Chu, "Cascaded incremental nonlinear dynamic inversion for
MAV disturbance rejection", Control Engineering Practice 73 (2018).

What was demanded is changed by what the acceleration falls short of; both go through the same filter, so that they are
of the same time. The disturbance is whatever lies between them: no observer is used.
"""

from math import exp

import numpy as np

from formation.maths.arrays import Vec3
from formation.own_law.law import Situation


class INDI:
    """kx_1_s2, kv_1_s: of the linear error dynamics; filter_rad_s: bandwidth of the filter of both accelerations."""

    def __init__(self, kx_1_s2: float = 12.0, kv_1_s: float = 6.0, filter_rad_s: float = 8.0) -> None:
        self._kx, self._kv, self._filter_rad_s = kx_1_s2, kv_1_s, filter_rad_s
        self._demanded: Vec3 | None = None
        self._demanded_filtered, self._vel_filtered = np.zeros(3), np.zeros(3)

    def __call__(self, at: Situation) -> Vec3:
        """The acceleration demanded in `lab`, m/s^2."""
        wanted = (
            at.slot.acc_lab_m_s2
            - self._kx * (at.own.pos_lab_m - at.slot.pos_lab_m)
            - self._kv * (at.own.vel_lab_m_s - at.slot.vel_lab_m_s)
        )
        if self._demanded is None:
            self._demanded, self._vel_filtered = wanted, at.own.vel_lab_m_s.copy()
            return wanted
        share = 1.0 - exp(-self._filter_rad_s * at.dt_s)
        lag_s = at.lag_s[0]
        # The vehicle answers what it is sent with a lag: the filter of the demand has it, too.
        slower = share / (1.0 + self._filter_rad_s * lag_s)
        self._demanded_filtered = self._demanded_filtered + slower * (self._demanded - self._demanded_filtered)
        before = self._vel_filtered
        self._vel_filtered = before + share * (at.own.vel_lab_m_s - before)
        measured = (self._vel_filtered - before) / max(at.dt_s, 1e-3)
        self._demanded = wanted if at.saturated else self._demanded_filtered + wanted - measured
        return self._demanded

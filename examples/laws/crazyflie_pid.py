"""The Crazyflie's own position controller, PID: position asks for a velocity, velocity for roll, pitch and thrust.

Gains and limits as in Bitcraze's documentation (Controllers in the Crazyflie; platform_defaults_cf2.h of firmware
2025.12). Where a setpoint has a position, its velocity is not used. Thrust is counted from a base that should hover.
"""

import numpy as np

from formation.maths.arrays import Vec3
from formation.own_law.law import Situation

GRAVITY_M_S2 = 9.81
U16 = 65535.0
BASE_U16, LEAST_U16, RAW_MOST_U16, PER_RAW_U16 = 36000.0, 20000.0, U16 / 2.0, 1000.0
SPEED_MOST_M_S, TILT_MOST_DEG = 1.1, 20.0


class CrazyfliePID:
    """kp_1_s: of x and y; kp_z_1_s, ki_z_1_s2: of z; tilt_deg_s_m, tilt_i_deg_m: degrees by velocity, and its integral;
    thrust_s_m, thrust_i_1_m: thrust likewise."""

    full_thrust_m_s2 = GRAVITY_M_S2 * U16 / BASE_U16
    """What it takes full thrust to accelerate at, where thrust is sent as a share of it."""

    def __init__(
        self, kp_1_s: float = 2.0, kp_z_1_s: float = 2.0, ki_z_1_s2: float = 0.5, tilt_deg_s_m: float = 25.0,
        tilt_i_deg_m: float = 1.0, thrust_s_m: float = 25.0, thrust_i_1_m: float = 15.0,
    ) -> None:  # fmt: skip
        self._kp, self._ki_z = np.array([kp_1_s, kp_1_s, kp_z_1_s]), ki_z_1_s2
        self._kp_speed = np.array([tilt_deg_s_m, tilt_deg_s_m, thrust_s_m])
        self._ki_speed = np.array([tilt_i_deg_m, tilt_i_deg_m, thrust_i_1_m])
        self._height_m_s, self._integral_m = 0.0, np.zeros(3)

    def __call__(self, at: Situation) -> Vec3:
        """The acceleration demanded in `lab`, m/s^2."""
        cos, sin = np.cos(at.heading_rad), np.sin(at.heading_rad)
        own_from_lab = np.array([[cos, sin, 0.0], [-sin, cos, 0.0], [0.0, 0.0, 1.0]])
        error_m = own_from_lab @ (at.slot.pos_lab_m - at.own.pos_lab_m)
        self._height_m_s += at.dt_s * error_m[2]
        wanted_m_s = self._kp * error_m + np.array([0.0, 0.0, self._ki_z * self._height_m_s])
        error_m_s = np.clip(wanted_m_s, -SPEED_MOST_M_S, SPEED_MOST_M_S) - own_from_lab @ at.own.vel_lab_m_s
        self._integral_m = self._integral_m + at.dt_s * error_m_s
        forward, left, raw = self._kp_speed * error_m_s + self._ki_speed * self._integral_m
        pitch, roll = np.radians(np.clip([forward, -left], -TILT_MOST_DEG, TILT_MOST_DEG))
        raw_u16 = np.clip(PER_RAW_U16 * raw, -RAW_MOST_U16, RAW_MOST_U16)
        thrust_m_s2 = GRAVITY_M_S2 / BASE_U16 * np.clip(BASE_U16 + raw_u16, LEAST_U16, U16)
        up = np.array([np.cos(roll) * np.sin(pitch), -np.sin(roll), np.cos(roll) * np.cos(pitch)])
        force_m_s2: Vec3 = thrust_m_s2 * own_from_lab.T @ up
        return force_m_s2 - np.array([0.0, 0.0, GRAVITY_M_S2])

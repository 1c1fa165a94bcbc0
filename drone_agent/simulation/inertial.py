"""What a simulated autopilot's accelerometer and gyroscope show: means over 5 ms of what the body does. No clock.

PX4 v1.16 integrates its sensors for 5 ms (IMU_INTEG_RATE, 200 Hz), and HIGHRES_IMU is the mean over the newest such
time, stamped with its end (src/modules/mavlink/streams/HIGHRES_IMU.hpp).
"""

from math import atan2, sqrt
from typing import Annotated

import numpy as np
from pydantic import Field

from drone_agent.flight.vehicle import ImuSample
from formation.maths.arrays import Float
from formation.maths.kernel import kernel
from formation.maths.quaternion import matrix_into
from formation.model import Model, Vec3Tuple
from formation.vehicle.body import GRAVITY_M_S2
from formation.vehicle.profile import VehicleState

WINDOW_NS = 5_000_000
_DRAWN = 256
NotNegative = Annotated[float, Field(ge=0.0, le=10.0)]


class InertialError(Model):
    """What the sensors are wrong by, along and about each axis of `flu`: RMS of each sample, and bias.

    The white noise is an ICM-42688-P's (70 ug and 2.8 mdeg/s per root of Hz). A vibration is far
    faster than samples come: the mean over one is the difference of a bounded function between its ends, so that what
    one sample shows too much the next shows too little. PX4's SIH instead gives an armed vehicle white noise, in each
    sample of 2.5 ms up to 1.7 m/s^2 and 0.14 rad/s: 0.92 and 0.065 over axes and two samples (scenario px4_eight).
    """

    noise_m_s2: NotNegative = 0.007
    vibration_m_s2: NotNegative = 0.3
    rate_noise_rad_s: NotNegative = 0.0005
    bias_flu_m_s2: Vec3Tuple = (0.03, -0.02, 0.02)
    rate_bias_flu_rad_s: Vec3Tuple = (0.0, 0.0, 0.0)
    seed: Annotated[int, Field(ge=0)] = 0


class InertialSensor:
    """The inertial sensors of one drone."""

    def __init__(self, error: InertialError, sysid: int) -> None:
        self._rng = np.random.default_rng([error.seed, 14, sysid])
        self._noise = np.array([error.noise_m_s2] * 3 + [error.rate_noise_rad_s] * 3)
        self._bias = np.array([*error.bias_flu_m_s2, *error.rate_bias_flu_rad_s])
        self._vibration_m_s2 = error.vibration_m_s2 * sqrt(0.5)
        self._vibrated = np.zeros(3)
        self._errors = np.empty((0, 6))
        self._next = 0

    def sample(self, start: VehicleState, end: VehicleState, t_ns: int, dt_s: float) -> ImuSample:
        """The mean between two states, dt_s apart, the later at t_ns."""
        if self._next == len(self._errors):
            self._errors, self._next = self._draw(), 0
        values = self._errors[self._next].copy()
        self._next += 1
        _add_mean(start.x, end.x, dt_s, values)
        return ImuSample(t_ns, values)

    def _draw(self) -> Float:
        errors: Float = self._rng.standard_normal((_DRAWN, 6)) * self._noise + self._bias
        shaken = np.vstack([self._vibrated, self._vibration_m_s2 * self._rng.standard_normal((_DRAWN, 3))])
        errors[:, :3] += np.diff(shaken, axis=0)
        self._vibrated = shaken[-1]
        return errors


@kernel
def _add_mean(start: Float, end: Float, dt_s: float, values: Float) -> None:
    """Add the mean specific force and body rate between two states (formation.vehicle.rigid_body) to values (6)."""
    # The mean of what turning axes show is, to second order, the mean force in the axes of half-way.
    qw, qx, qy, qz = start[6], start[7], start[8], start[9]
    pw, px, py, pz = end[6], end[7], end[8], end[9]
    cosine = qw * pw + qx * px + qy * py + qz * pz
    side = 1.0 if cosine >= 0.0 else -1.0
    halfway, r_lab_from_flu = np.empty(4), np.empty((3, 3))
    for n in range(4):
        halfway[n] = start[6 + n] + side * end[6 + n]
    norm = sqrt(halfway[0] ** 2 + halfway[1] ** 2 + halfway[2] ** 2 + halfway[3] ** 2)
    for n in range(4):
        halfway[n] /= norm
    matrix_into(halfway, r_lab_from_flu)
    for axis in range(3):
        for lab in range(3):
            force = (end[3 + lab] - start[3 + lab]) / dt_s + (GRAVITY_M_S2 if lab == 2 else 0.0)
            values[axis] += r_lab_from_flu[lab, axis] * force
    x = qw * px - qx * pw - qy * pz + qz * py
    y = qw * py + qx * pz - qy * pw - qz * px
    z = qw * pz - qx * py + qy * px - qz * pw
    sine = sqrt(x * x + y * y + z * z)
    scale = side * (2.0 * atan2(sine, abs(cosine)) / sine if sine > 0.0 else 2.0) / dt_s
    values[3] += scale * x
    values[4] += scale * y
    values[5] += scale * z

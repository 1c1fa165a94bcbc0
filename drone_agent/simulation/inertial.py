"""What a simulated autopilot's accelerometer and gyroscope show: means over 5 ms of what the body does. No clock.

PX4 v1.16 integrates its sensors for 5 ms (IMU_INTEG_RATE, 200 Hz), and HIGHRES_IMU is the mean over the newest such
time, stamped with its end (src/modules/mavlink/streams/HIGHRES_IMU.hpp). Ours may overlap where more are asked for.
"""

from collections import deque
from dataclasses import dataclass
from math import atan2, hypot, sqrt
from typing import Annotated

import numpy as np
from pydantic import Field

from formation.maths.arrays import Quat, Vec3
from formation.model import Model, Vec3Tuple
from formation.vehicle.body import GRAVITY_M_S2
from formation.vehicle.profile import VehicleState
from formation.vehicle.rigid_body import rotation

WINDOW_NS = 5_000_000
_GRAVITY_LAB_M_S2 = np.array([0.0, 0.0, GRAVITY_M_S2])
NotNegative = Annotated[float, Field(ge=0.0, le=10.0)]


class InertialError(Model):
    """White noise of each sample of the accelerometer, along each body axis, m/s^2 RMS; zero: there is none."""

    noise_m_s2: NotNegative = 0.3
    seed: Annotated[int, Field(ge=0)] = 0


@dataclass(frozen=True, slots=True)
class ImuSample:
    """Means over WINDOW_NS until `t_ns`, in `flu`: specific force, m/s^2 (+g along up at rest), and rate, rad/s."""

    t_ns: int
    specific_force_flu_m_s2: Vec3
    rate_flu_rad_s: Vec3


class InertialSensor:
    """The inertial sensors of one drone: `note` receives its body's states, `sample` returns the mean.

    A window begins at a noted state: at those `next_ns` asks for where samples are taken on the same raster, at any
    where `finely`.
    """

    def __init__(
        self, error: InertialError, bias_lab_m_s2: Vec3Tuple, sysid: int, t0_ns: int = 0, *, finely: bool = False
    ) -> None:
        """bias_lab_m_s2: what the accelerometer is wrong by, as the estimator's dead reckoning has it too."""
        self._t0_ns = t0_ns
        self.finely = finely
        self._rng = np.random.default_rng([error.seed, 14, sysid])
        self._noise_m_s2 = error.noise_m_s2
        self._at_rest_lab_m_s2 = _GRAVITY_LAB_M_S2 + bias_lab_m_s2
        self._steps: deque[tuple[int, VehicleState]] = deque()

    def reset(self) -> None:
        """Drop the steps until now: they are in no later sample."""
        self._steps.clear()

    def next_ns(self, t_ns: int, step_ns: int) -> int:
        """The time after t_ns whose state is to be noted; step_ns: of the body's own grid."""
        return t_ns + step_ns if self.finely else t_ns + WINDOW_NS - (t_ns - self._t0_ns) % WINDOW_NS

    def note(self, t_ns: int, state: VehicleState) -> None:
        """The body is in `state` at `t_ns`, later than noted before; the state is kept, and not to be changed."""
        steps = self._steps
        steps.append((t_ns, state))
        while len(steps) > 1 and t_ns - steps[1][0] >= WINDOW_NS:
            steps.popleft()

    def sample(self) -> ImuSample | None:
        """The newest sample, with noise of its own each time it is taken; None until there is a whole one."""
        if not self._steps:
            return None
        (start_ns, start), (end_ns, end) = self._steps[0], self._steps[-1]
        if end_ns - start_ns < WINDOW_NS:
            return None
        gained_lab_m_s = end.vel_lab_m_s - start.vel_lab_m_s
        force_lab_m_s2 = gained_lab_m_s / ((end_ns - start_ns) * 1e-9) + self._at_rest_lab_m_s2
        # The mean of what turning axes show is, to second order, the mean force in the axes of half-way.
        q, p = start.q_lab_from_flu, end.q_lab_from_flu
        halfway, r_lab_from_flu = np.empty_like(end.x), np.empty((3, 3))
        between = p + q if p @ q >= 0.0 else p - q
        halfway[6:10] = between / sqrt(between @ between)
        rotation(halfway, r_lab_from_flu)
        force_flu_m_s2 = force_lab_m_s2 @ r_lab_from_flu
        rate_flu_rad_s = _turn_rad(q, p) / ((end_ns - start_ns) * 1e-9)
        noise_m_s2 = self._noise_m_s2 * self._rng.standard_normal(3)
        return ImuSample(end_ns, force_flu_m_s2 + noise_m_s2, rate_flu_rad_s)


def _turn_rad(q: Quat, p: Quat) -> Vec3:
    """The rotation vector from attitude q to attitude p, in `flu`."""
    (qw, qx, qy, qz), (pw, px, py, pz) = q.tolist(), p.tolist()
    w = qw * pw + qx * px + qy * py + qz * pz
    x = qw * px - qx * pw - qy * pz + qz * py
    y = qw * py + qx * pz - qy * pw - qz * px
    z = qw * pz - qx * py + qy * px - qz * pw
    sine = hypot(x, y, z)
    scale = 2.0 * atan2(sine, abs(w)) / sine if sine > 0.0 else 2.0
    return np.array([x, y, z]) * (scale if w >= 0.0 else -scale)

"""The attitude bias of a simulated autopilot's level estimate, a slow random process. No vehicle, no clock.

PX4 v1.16.1 in its own simulation (SIH), its attitude estimate against the true one while it held its place: along each
horizontal axis 0.3 to 0.7 degrees RMS about a mean of up to 1.5, correlated over 1.6 to 4.9 s, with outside poses as
with GPS. SIH gives armed vehicles white noise of 0.14 rad/s and 1.7 m/s^2; a quieter vehicle has a smaller bias.
"""

from math import exp, sqrt
from typing import Annotated

import numpy as np
from pydantic import Field

from formation.maths.arrays import Quat
from formation.maths.frames import from_rotation_vector, inverse, multiply
from formation.model import Model, Positive

STEP_NS = 10_000_000
NotNegative = Annotated[float, Field(ge=0.0, le=0.2)]


class LevelError(Model):
    """A first-order Gauss-Markov attitude bias about lab x and about lab y, each of this RMS, rad; zero: none."""

    rms_rad: NotNegative = 0.0
    correlation_s: Positive = 2.5
    seed: Annotated[int, Field(ge=0)] = 0


class AttitudeBias:
    """The attitude bias of one drone over time, in steps of STEP_NS from t0_ns."""

    def __init__(self, error: LevelError, sysid: int, t0_ns: int) -> None:
        self._rng = np.random.default_rng([error.seed, 5, sysid])
        self._decay = exp(-STEP_NS * 1e-9 / error.correlation_s)
        self._kick_rad = error.rms_rad * sqrt(1.0 - self._decay * self._decay)
        self._bias_rad = error.rms_rad * self._rng.standard_normal(2)
        self._t_ns = t0_ns
        self._q_est_from_true: Quat = self._turn()

    @property
    def next_ns(self) -> int:
        """When it changes next."""
        return self._t_ns + STEP_NS

    def advance_to(self, now_ns: int) -> None:
        """Let it wander up to `now_ns`."""
        while now_ns >= self.next_ns:
            self._bias_rad = self._decay * self._bias_rad + self._kick_rad * self._rng.standard_normal(2)
            self._t_ns += STEP_NS
        self._q_est_from_true = self._turn()

    def estimated(self, q_lab_from_flu: Quat) -> Quat:
        """The attitude that the autopilot takes a true one for."""
        return multiply(self._q_est_from_true, q_lab_from_flu)

    def true(self, q_lab_from_flu: Quat) -> Quat:
        """What it flies when it believes that it flies this."""
        return multiply(inverse(self._q_est_from_true), q_lab_from_flu)

    def _turn(self) -> Quat:
        return from_rotation_vector(np.array([*self._bias_rad, 0.0]))

"""Linear model predictive control: Maciejowski, "Predictive Control with Constraints" (2002), ch. 3, condensed.

A double integrator behind the vehicle's lag, the observer's disturbance taken out, the acceleration bounded. The box is
met by an accelerated projected gradient (Richter, Jones, Morari, "Computational complexity certification for real-time
MPC with input constraints", IEEE TAC 2012), warm-started: NumPy alone, no solver.
"""

from math import exp

import numpy as np

from formation.maths.arrays import Float, Vec3
from formation.own_law.law import Situation

STEPS, STEP_S, ROUNDS = 15, 0.05, 12


class LinearMPC:
    """q_pos, q_vel: weights of position and velocity errors beside 1 for the acceleration; most_m_s2: its bound."""

    def __init__(self, q_pos: float = 120.0, q_vel: float = 10.0, most_m_s2: float = 6.0) -> None:
        self._weights, self._most = np.array([q_pos, q_vel, 0.0]), most_m_s2
        self._plan = np.zeros((STEPS, 3))
        self._lag_s = 0.0
        self._free, self._forced, self._hessian = np.zeros((0, 0)), np.zeros((0, 0)), np.zeros((0, 0))

    def _condense(self, lag_s: float) -> None:
        """Errors over the horizon as free response to the state now and forced response to the inputs."""
        keep = exp(-STEP_S / lag_s)
        a = np.array([[1.0, STEP_S, 0.5 * STEP_S**2], [0.0, 1.0, STEP_S], [0.0, 0.0, keep]])
        b = np.array([0.0, 0.0, 1.0 - keep])
        powers = [np.linalg.matrix_power(a, k) for k in range(STEPS + 1)]
        self._free = np.vstack(powers[1:])
        self._forced = np.zeros((3 * STEPS, STEPS))
        for k in range(STEPS):
            for j in range(k + 1):
                self._forced[3 * k : 3 * k + 3, j] = powers[k - j] @ b
        weighted = np.tile(self._weights, STEPS)[:, None] * self._forced
        self._hessian = self._forced.T @ weighted + np.eye(STEPS)
        self._linear: Float = weighted.T @ self._free
        self._slope = float(np.linalg.eigvalsh(self._hessian)[-1])
        self._lag_s = lag_s

    def __call__(self, at: Situation) -> Vec3:
        """The acceleration demanded in `lab`, m/s^2."""
        if at.lag_s[0] != self._lag_s:
            self._condense(at.lag_s[0])
        ahead = at.slot.acc_lab_m_s2
        state = np.stack(
            [
                at.own.pos_lab_m - at.slot.pos_lab_m,
                at.own.vel_lab_m_s - at.slot.vel_lab_m_s,
                at.own.acc_lab_m_s2 - ahead,
            ]
        )
        gradient_0, plan = self._linear @ state, np.vstack([self._plan[1:], self._plan[-1:]])
        low, high = -self._most - ahead, self._most - ahead
        guess, momentum = plan, 1.0
        for _ in range(ROUNDS):
            new = np.clip(guess - (self._hessian @ guess + gradient_0) / self._slope, low, high)
            grown = 0.5 * (1.0 + np.sqrt(1.0 + 4.0 * momentum**2))
            guess, plan, momentum = new + (momentum - 1.0) / grown * (new - plan), new, grown
        self._plan = plan
        return ahead + plan[0] - at.disturbance_lab_m_s2

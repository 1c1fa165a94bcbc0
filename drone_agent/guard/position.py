"""The autopilot's own position controller: P on position, PI on velocity, thrust vector to attitude and thrust.

It flies the agent's take-off, hold, landing and level flight; the formation's control law is the ground's.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from formation.maths.arrays import Quat, Vec3
from formation.maths.quaternion import attitude_of
from formation.model import Vec3Tuple
from formation.vehicle.body import GRAVITY_M_S2

_P_1_S, _P_UP_1_S = 1.2, 1.5
_P_VEL_1_S, _P_VEL_UP_1_S = 3.5, 5.0
_I_VEL_1_S2, _I_VEL_UP_1_S2 = 1.2, 2.0
_I_MAX_M_S2 = 3.0
_SPEED_MAX_M_S, _CLIMB_MAX_M_S = 1.5, 1.5
_TILT_MAX = math.tan(0.45)
_LIFT_MIN_M_S2 = 0.3 * GRAVITY_M_S2
NO_RATE = np.zeros(3)
NO_RATE.setflags(write=False)


class Belief(NamedTuple):
    """Where the autopilot thinks it is, in its own estimate's frame (`lab` if the external pose is right)."""

    pos_lab_m: Vec3Tuple
    vel_lab_m_s: Vec3Tuple
    yaw_rad: float


class LoopSetpoint:
    """What the attitude loop tracks: attitude, body-rate feed-forward and collective thrust (0..1).

    target (8): the three in a row, as the kernel takes them; not to be changed.
    """

    __slots__ = ("target",)

    def __init__(self, q_lab_from_flu: Quat, rate_flu_rad_s: Vec3, thrust_norm: float) -> None:
        self.target = np.empty(8)
        self.target[0:4], self.target[4:7], self.target[7] = q_lab_from_flu, rate_flu_rad_s, thrust_norm

    @property
    def q_lab_from_flu(self) -> Quat:
        """Attitude."""
        return self.target[0:4]

    @property
    def rate_flu_rad_s(self) -> Vec3:
        """Body rate that is fed forward."""
        return self.target[4:7]

    @property
    def thrust_norm(self) -> float:
        """Collective thrust, 0..1."""
        return float(self.target[7])


class Demand(NamedTuple):
    """What to fly: a place, a speed or neither (then level), a height or none (then `climb_m_s` alone), a heading."""

    yaw_rad: float
    pos_lab_m: tuple[float, float] | None = None
    speed_lab_m_s: tuple[float, float] | None = None
    height_m: float | None = None
    climb_m_s: float = 0.0
    attitude: Quat | None = None
    """Fly this attitude, only the vertical is the controller's."""


class PositionController:
    """One vehicle's loop; `step` at a steady rate, `reset` when it takes over."""

    def __init__(self, thrust_of: Callable[[float], float]) -> None:
        """thrust_of: the thrust_norm that gives a specific force, m/s^2."""
        self._thrust_of = thrust_of
        self._sum = [0.0, 0.0, 0.0]
        self.thrust_scale = 1.0
        """Delivered over modelled thrust, as far as it is known."""

    def reset(self, learnt_lab_m_s2: Vec3Tuple = (0.0, 0.0, 0.0)) -> None:
        """Forget what the integrators learnt, or begin with what is known already."""
        self._sum = list(learnt_lab_m_s2)

    def step(self, demand: Demand, belief: Belief, dt_s: float) -> LoopSetpoint:
        """Attitude and thrust that take the vehicle towards the demand."""
        ax, ay = self._sideways(demand, belief, dt_s)
        lift = max(self._upwards(demand, belief, dt_s) + GRAVITY_M_S2, _LIFT_MIN_M_S2)
        side = math.hypot(ax, ay)
        if side > _TILT_MAX * lift:
            ax, ay = ax * _TILT_MAX * lift / side, ay * _TILT_MAX * lift / side
        if demand.attitude is None:
            q = np.empty(4)
            attitude_of(ax, ay, lift, demand.yaw_rad, q)
            force = math.sqrt(ax * ax + ay * ay + lift * lift)
        else:
            q = demand.attitude
            force = lift / max(1.0 - 2.0 * float(q[1] * q[1] + q[2] * q[2]), 0.5)
        return LoopSetpoint(q, NO_RATE, self._thrust_of(force / self.thrust_scale))

    def _sideways(self, demand: Demand, belief: Belief, dt_s: float) -> tuple[float, float]:
        if demand.pos_lab_m is not None:
            pos = demand.pos_lab_m
            vel = [_P_1_S * (pos[i] - belief.pos_lab_m[i]) for i in (0, 1)]
        elif demand.speed_lab_m_s is not None:
            vel = list(demand.speed_lab_m_s)
        else:
            return 0.0, 0.0
        speed = math.hypot(*vel)
        scale = min(1.0, _SPEED_MAX_M_S / speed) if speed > 0.0 else 1.0
        x, y = (
            self._velocity_loop(i, scale * vel[i] - belief.vel_lab_m_s[i], _P_VEL_1_S, _I_VEL_1_S2, dt_s)
            for i in (0, 1)
        )
        return x, y

    def _upwards(self, demand: Demand, belief: Belief, dt_s: float) -> float:
        climb = demand.climb_m_s
        if demand.height_m is not None:
            climb += _P_UP_1_S * (demand.height_m - belief.pos_lab_m[2])
        climb = min(max(climb, -_CLIMB_MAX_M_S), _CLIMB_MAX_M_S)
        return self._velocity_loop(2, climb - belief.vel_lab_m_s[2], _P_VEL_UP_1_S, _I_VEL_UP_1_S2, dt_s)

    def _velocity_loop(self, axis: int, error: float, p: float, i: float, dt_s: float) -> float:
        total = self._sum[axis] + i * error * dt_s
        self._sum[axis] = min(max(total, -_I_MAX_M_S2), _I_MAX_M_S2)
        return p * error + self._sum[axis]


def warm_up() -> None:
    """Compile what `PositionController` calls: nothing compiles in flight."""
    attitude_of(0.0, 0.0, 1.0, 0.0, np.empty(4))

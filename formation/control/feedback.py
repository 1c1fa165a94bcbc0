"""The one place where a law is chosen: error in, feedback acceleration out, for one axis of one vehicle."""

from dataclasses import dataclass, replace
from enum import IntEnum

import numpy as np

from formation.control.geometric import tracking_acceleration
from formation.control.pid import velocity_error, velocity_pid
from formation.control.sliding_mode import (
    equivalent_and_reaching,
    sliding_variable,
    super_twisting,
    super_twisting_rate,
    switching,
)
from formation.maths.arrays import Float
from formation.maths.kernel import kernel


class Law(IntEnum):
    """The controllers of the comparison."""

    SMC = 0
    ISTSMC = 1
    CFC = 2
    PID = 3
    GEOMETRIC = 4


SMC, ISTSMC, CFC, PID, GEOMETRIC = (int(law) for law in Law)


@dataclass(frozen=True, slots=True)
class SlidingGains:
    """Gains of Eqs. (5)-(7): SMC uses c and k, ISTSMC and CFC c, p1, p2, eps; smooth rounds the powers off, m/s."""

    law: Law
    c: float
    p1: float = 0.0
    p2: float = 0.0
    eps: float = 0.0
    smooth_m_s: float = 0.0
    k: float = 0.0

    def paced(self, pace: float) -> "SlidingGains":
        """The same law, its rates multiplied by `pace`."""
        return replace(self, c=pace * self.c, p1=pace * self.p1, p2=pace * pace * self.p2)

    def row(self) -> Float:
        """As the kernels read it."""
        return np.array([self.law, self.c, self.p1, self.p2, self.eps, self.smooth_m_s, self.k])


@dataclass(frozen=True, slots=True)
class CascadeGains:
    """Gains of the double-loop PID: position P, 1/s, then velocity P, 1/s, I, 1/s^2, and D."""

    kp_position: float
    kp: float
    ki: float
    kd: float = 0.0

    def paced(self, pace: float) -> "CascadeGains":
        """The same law, its rates multiplied by `pace`."""
        return replace(self, kp_position=pace * self.kp_position, kp=pace * self.kp, ki=pace * pace * self.ki)

    def row(self) -> Float:
        """As the kernels read it."""
        return np.array([Law.PID, self.kp_position, self.kp, self.ki, self.kd, 0.0, 0.0])


@dataclass(frozen=True, slots=True)
class GeometricGains:
    """Gains of the SE(3) controller, per unit mass: kx, kv, ki, the integral's position share, its bound."""

    kx: float
    kv: float
    ki: float
    mix: float
    bound: float

    def paced(self, pace: float) -> "GeometricGains":
        """The same law, its rates multiplied by `pace`."""
        square = pace * pace
        return replace(self, kx=square * self.kx, kv=pace * self.kv, ki=square * self.ki, mix=pace * self.mix)

    def row(self) -> Float:
        """As the kernels read it."""
        return np.array([Law.GEOMETRIC, self.kx, self.kv, self.ki, self.mix, self.bound, 0.0])


AxisGains = SlidingGains | CascadeGains | GeometricGains


@kernel
def uses_disturbance(gains: Float) -> bool:
    """Whether the law subtracts the observer's Z3 (CFC), or fights disturbances by its own integral."""
    return int(gains[0]) == CFC


@kernel
def feedback(
    gains: Float, e: float, e_rate: float, e_acc: float, memory: float, boost: float, speed_max: float, dt_s: float
) -> tuple[float, float, float, float, float]:
    """s, t_m, the law's new memory (z_m or integral), the feedback acceleration, and that acceleration's rate.

    e, e_rate, e_acc: relative error, lead frame; boost: factor on p1. |e| is cut where closing it would ask for more
    than speed_max.
    The rate holds while errors evolve as predicted; it is what inverts the vehicle's first-order lag.
    """
    law = int(gains[0])
    if law == GEOMETRIC:
        kx, kv, ki, mix, bound = gains[1], gains[2], gains[3], gains[4], gains[5]
        reach = speed_max * kv / kx
        e = min(max(e, -reach), reach)
        acc, memory = tracking_acceleration(e, e_rate, memory, kx, kv, ki, mix, bound, dt_s)
        s = mix * e + e_rate
        return s, -acc, memory, acc, -kx * e_rate - kv * e_acc - ki * s
    if law == PID:
        kp_position, kp, ki, kd = gains[1], gains[2], gains[3], gains[4]
        reach = speed_max / kp_position
        e = min(max(e, -reach), reach)
        s = velocity_error(kp_position, e, e_rate)
        s_rate = velocity_error(kp_position, e_rate, e_acc)
        acc, memory = velocity_pid(s, s_rate, memory, kp, ki, kd, dt_s)
        return s, -acc, memory, acc, -kp * s_rate - ki * s
    c, p1, p2, eps, smooth, k = gains[1], boost * gains[2], gains[3], gains[4], gains[5], gains[6]
    reach = speed_max / c
    e = min(max(e, -reach), reach)
    s = sliding_variable(c, e, e_rate)
    s_rate = sliding_variable(c, e_rate, e_acc)
    t_rate = 0.0
    if law == SMC:
        t_m = switching(s, k)
    else:
        t_m, memory = super_twisting(s, memory, p1, p2, eps, smooth, dt_s)
        if smooth > 0.0:
            t_rate = super_twisting_rate(s, s_rate, p1, p2, eps, smooth)
    return s, t_m, memory, equivalent_and_reaching(c, e_rate, t_m), -c * e_acc - t_rate

"""Gains of every law, by name. Nothing is compiled here."""

from dataclasses import dataclass, replace
from enum import IntEnum


class Law(IntEnum):
    """The controllers of the comparison."""

    SMC = 0
    ISTSMC = 1
    CFC = 2
    PID = 3
    GEOMETRIC = 4


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

    def scaled(self, rate: float) -> "SlidingGains":
        """The same law, its rates multiplied by `rate`."""
        return replace(self, c=rate * self.c, p1=rate * self.p1, p2=rate * rate * self.p2)


@dataclass(frozen=True, slots=True)
class CascadeGains:
    """Gains of the double-loop PID: position P, 1/s, then velocity P, 1/s, I, 1/s^2, and D."""

    kp_position: float
    kp: float
    ki: float
    kd: float = 0.0

    def scaled(self, rate: float) -> "CascadeGains":
        """The same law, its rates multiplied by `rate`."""
        return replace(self, kp_position=rate * self.kp_position, kp=rate * self.kp, ki=rate * rate * self.ki)


@dataclass(frozen=True, slots=True)
class GeometricGains:
    """Gains of the SE(3) controller, per unit mass: kx, kv, ki, the integral's position share, its bound."""

    kx: float
    kv: float
    ki: float
    mix: float
    bound: float

    def scaled(self, rate: float) -> "GeometricGains":
        """The same law, its rates multiplied by `rate`."""
        square = rate * rate
        return replace(self, kx=square * self.kx, kv=rate * self.kv, ki=square * self.ki, mix=rate * self.mix)


Gains = SlidingGains | CascadeGains | GeometricGains


@dataclass(frozen=True, slots=True)
class AxisGains:
    """One axis's law and its gains, as a record of which the law's own part counts (formation.maths.records)."""

    law: Law
    sliding: SlidingGains
    cascade: CascadeGains
    geometric: GeometricGains


def axis_gains(gains: Gains) -> AxisGains:
    """The gains as the kernels read them."""
    law, sliding = Law.PID, SlidingGains(Law.PID, 0.0)
    cascade, geometric = CascadeGains(0.0, 0.0, 0.0), GeometricGains(0.0, 0.0, 0.0, 0.0, 0.0)
    match gains:
        case SlidingGains():
            law, sliding = gains.law, gains
        case CascadeGains():
            cascade = gains
        case GeometricGains():
            law, geometric = Law.GEOMETRIC, gains
    return AxisGains(law, sliding, cascade, geometric)


@dataclass(frozen=True, slots=True)
class LagCompensation:
    """How hard the lag is inverted, and what the observer's adaptive gain (formation.estimation) adds.

    rate: share of the lag times the demand's own rate that is sent ahead; gain: lag over wanted lag, how much harder
    than needed the command pulls at what the predicted acceleration misses of the demand, times adaptive gain to
    gain_power; p1_power: p1 is multiplied by the adaptive gain to this power; lead_share: a follower's adaptive gain is
    at least that of a leader that is only seen, to this power.
    """

    rate: float = 1.0
    gain: float = 1.0
    gain_power: float = 0.0
    p1_power: float = 0.0
    lead_share: float = 0.0

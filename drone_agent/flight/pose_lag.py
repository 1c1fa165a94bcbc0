"""Detects poses older than their stamps on a body that only moves vertically: its gravity direction does not turn then.

    offset(t) = b(t) - L v(t),   y = H offset,   u = H v,   L = -sum(y u) / sum(u u)

offset: pose minus dead reckoning, b: what that wanders by, slowly; v: the velocity, all of the vertical.
H = (s / (s + p))^3 takes b out and leaves how a vehicle swings that is controlled by late poses. The sums fade.
Horizontally an attitude bias turns with the heading as the velocity does, and looks like a delay: there the attitude
shows late poses (`formation.safety.attitude_innovation`).
"""

from math import exp

from drone_agent.flight.fading import second_degree

MOST_S = 0.08
"""Poses that are later are not used; the control bears what is less."""
_POLE_1_S, _MEMORY_S = 1.2, 1.0
_SWING_M_S, _SWING_M, _SIGMAS = 0.1, 0.02, 4.0
"""What velocity and offset must swing by, RMS: so much, and the offset so many times what noise makes of it."""
_WALK_S3 = 0.04
"""Variance of y over the density of a velocity's random walk, simulated."""
_ALIKE = 0.6
"""Share of that swing, in squares, that goes with the velocity, as that of a delay of a seventh of a period does."""
_YOUNG_NS = 2_500_000_000
"""Before, a velocity that dead reckoning did not know when it began is taken for a swing."""


class PoseLag:
    """Of one body, since it was first seen."""

    def __init__(self, t_ns: int, offset_m: float, vel_m_s: float) -> None:
        """offset_m: pose minus dead reckoning, vel_m_s: the predicted velocity; both vertical."""
        self._since_ns = self._t_ns = t_ns
        self._offset, self._vel = [offset_m, 0.0, 0.0], [vel_m_s, 0.0, 0.0]
        self._yy = self._yu = self._uu = 0.0

    @property
    def on_time(self) -> list[float]:
        """Place, rate and acceleration of the offset, were the poses on time: what is left of it without -L v."""
        lag_s = -self._yu / self._uu if self._uu > 0.0 else 0.0
        return [shown + lag_s * moved for shown, moved in zip(self._offset, self._vel, strict=True)]

    def update(self, t_ns: int, offset_m: float, vel_m_s: float, noise_m2: float, walk_m2_s3: float) -> bool:
        """Take one pose in, later than the last; whether those of the last second were late by more than `MOST_S`.

        noise_m2: variance of the poses. walk_m2_s3: density of the velocity's random walk.
        """
        dt_s, self._t_ns = (t_ns - self._t_ns) * 1e-9, t_ns
        decay, share = exp(-_POLE_1_S * dt_s), 1.0 - exp(-dt_s / _MEMORY_S)
        y = second_degree(self._offset, offset_m, decay, dt_s)
        u = second_degree(self._vel, vel_m_s, decay, dt_s)
        self._yy += share * (y * y - self._yy)
        self._yu += share * (y * u - self._yu)
        self._uu += share * (u * u - self._uu)
        moves = self._uu > _SWING_M_S**2
        swings = self._yy > max(_SWING_M**2, _SIGMAS**2 * (noise_m2 + _WALK_S3 * walk_m2_s3))
        alike = self._yu * self._yu > _ALIKE * self._yy * self._uu
        return moves and swings and alike and -self._yu > MOST_S * self._uu and t_ns - self._since_ns > _YOUNG_NS

"""What thrust would hover a body, by the thrust it flies with and what that makes of its motion. No bytes, no clock.

    hover = mean thrust * g / mean lift

The lift is what the accelerometer feels along the body's z axis; without one g and what the climb gains, the climb
less its own mean over the averaging time. While a body climbs ever faster the thrust alone says too much.
"""

import math

from formation.vehicle.body import GRAVITY_M_S2

AVERAGED_S = 0.25
_FRESH_NS = 100_000_000
_LEAST, _MOST = 0.6, 1.6
"""Of its weight: the lift that is believed."""


class HoverThrust:
    """One body's. `fly` at every command that it follows."""

    def __init__(self) -> None:
        self._t_ns: int | None = None
        self._thrust = math.nan
        self._climb_m_s = self._mean_climb_m_s = 0.0
        self._felt_m_s2 = self._lift_m_s2 = GRAVITY_M_S2
        self._felt_ns = -(2**62)

    def feel(self, lift_m_s2: float, now_ns: int) -> None:
        """What the accelerometer shows along the body's z axis."""
        if math.isfinite(lift_m_s2):
            self._felt_m_s2, self._felt_ns = lift_m_s2, now_ns

    def climbs(self, climb_m_s: float, *, anew: bool = False) -> None:
        """How fast it is seen to climb; anew: by other means than before."""
        if anew:
            self._mean_climb_m_s += climb_m_s - self._climb_m_s
        self._climb_m_s = climb_m_s

    def fly(self, thrust: float, now_ns: int, *, seen: bool) -> float:
        """It flies with this thrust from now on; what is neither seen nor felt tells nothing.

        Returns the share of what is new in the averages.
        """
        if self._t_ns is None:
            self._t_ns, self._thrust = now_ns, thrust
        if not (seen or self._felt(now_ns)):
            return 0.0
        share = 1.0 - math.exp(-(now_ns - self._t_ns) * 1e-9 / AVERAGED_S)
        self._t_ns = now_ns
        self._thrust += share * (thrust - self._thrust)
        self._mean_climb_m_s += share * (self._climb_m_s - self._mean_climb_m_s)
        gained_m_s2 = (self._climb_m_s - self._mean_climb_m_s) / AVERAGED_S
        if self._felt(now_ns):
            self._lift_m_s2 += share * (self._felt_m_s2 - self._lift_m_s2)
        else:
            self._lift_m_s2 = GRAVITY_M_S2 + gained_m_s2
        return share

    @property
    def thrust_norm(self) -> float:
        """NaN before the first command."""
        return self._thrust / min(max(self._lift_m_s2 / GRAVITY_M_S2, _LEAST), _MOST)

    def _felt(self, now_ns: int) -> bool:
        return now_ns - self._felt_ns < _FRESH_NS

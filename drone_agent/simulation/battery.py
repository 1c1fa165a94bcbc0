"""A LiPo pack under load: charge used, voltage with sag, what is left of the thrust."""

from itertools import pairwise

import numpy as np

from formation.vehicle.profile import BatteryProfile

_CELL_FULL_V = 4.2
_CELL_EMPTY_V = 3.3
# The knee of a LiPo's resting curve: flat in the middle, steep below a tenth.
_REST_CURVE = ((0.0, _CELL_EMPTY_V), (0.1, 3.68), (0.5, 3.82), (0.9, 4.08), (1.0, _CELL_FULL_V))


SAG_V = 0.12
"""Of a cell, in hover."""


class BatteryPack:
    """The state of one pack; `drain` is called with what the motors do."""

    def __init__(self, profile: BatteryProfile, remaining: float = 1.0) -> None:
        self.profile = profile
        self.current_a = 0.0
        self.used_mah = 0.0
        self.set_remaining(remaining)

    def set_remaining(self, remaining: float) -> None:
        """Charge it, or drain it, to this share."""
        self.used_mah = (1.0 - remaining) * self.profile.capacity_mah
        self.thrust_scale = self._thrust_scale()

    def drain(self, thrust_to_weight: float, dt_s: float) -> None:
        """Spend `dt_s` at a collective thrust: induced power goes with thrust to the power 3/2."""
        load = max(thrust_to_weight, 0.0) ** 1.5 + 0.03  # of hovering, at rest
        self.current_a = self.profile.hover_current_a * load
        self.used_mah = min(self.used_mah + self.current_a * dt_s / 3.6, self.profile.capacity_mah)
        self.thrust_scale = self._thrust_scale()

    @property
    def cells(self) -> int:
        """In series."""
        return self.profile.cells

    @property
    def remaining(self) -> float:
        """Charge left, 0..1."""
        return 1.0 - self.used_mah / self.profile.capacity_mah

    @property
    def cell_v(self) -> float:
        """Voltage of each cell: resting voltage at this charge less the sag of the present current."""
        sag = SAG_V * self.current_a / self.profile.hover_current_a
        return max(_rest_v(self.remaining) - sag, 0.0)

    @property
    def voltage_v(self) -> float:
        """Voltage of the pack."""
        return self.cell_v * self.profile.cells

    def _thrust_scale(self) -> float:
        """What this charge leaves of the full thrust, 0..1."""
        return 1.0 - (1.0 - self.profile.empty_thrust_fraction) * (1.0 - self.remaining)


def _rest_v(remaining: float) -> float:
    for (low, low_v), (high, high_v) in pairwise(_REST_CURVE):
        if remaining <= high:
            return low_v + (high_v - low_v) * (remaining - low) / (high - low)
    return _CELL_FULL_V


def remaining_at(rest_v: float) -> float:
    """The charge, 0..1, of a cell that rests at that voltage; NaN for NaN."""
    return float(np.interp(rest_v, *np.array(_REST_CURVE).T[::-1]))

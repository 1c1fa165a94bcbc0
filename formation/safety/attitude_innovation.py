"""The attitude innovation of one body: its mocap attitude against the gravity direction of its own sensors.

The drone's own gravity direction needs no camera. A constant difference is the tilt of the marker frame. A difference
that grows while the drone turns is a delay which no stamp shows and the controller cannot know. Pure: no frames, no
clock.
"""

from math import exp, hypot, sqrt

import numpy as np

from formation.maths.arrays import Float, Quats
from formation.maths.kernel import kernel

LAG_S, BIAS_LAG_S, BIAS_MAX_RAD = 0.2, 3.0, 0.1
CLOCK_DOUBT_S = 0.03
"""How far the two clocks, and the two ways of filtering, may be apart: what that makes of a turn is no miss."""
MOST_RAD = 0.05
"""So great a miss, for a tenth of a second, is late poses'."""
GAP_S = 0.2

Tilt = tuple[float, float]
"""Gravity's direction in the body's axes, x and y."""


def tilt(q_lab_from_flu: list[float]) -> Tilt:
    """Of an attitude w, x, y, z."""
    w, x, y, z = q_lab_from_flu
    return 2.0 * (x * z - w * y), 2.0 * (y * z + w * x)


def tilts(q_lab_from_flu: Quats) -> list[Tilt]:
    """The same of many (n, 4), to the bit."""
    return [(x, y) for x, y in _tilts(np.ascontiguousarray(q_lab_from_flu)).tolist()]


@kernel
def _tilts(q_lab_from_flu: Quats) -> Float:
    out = np.empty((len(q_lab_from_flu), 2))
    for i in range(len(q_lab_from_flu)):
        w, x, y, z = q_lab_from_flu[i, 0], q_lab_from_flu[i, 1], q_lab_from_flu[i, 2], q_lab_from_flu[i, 3]
        out[i, 0], out[i, 1] = 2.0 * (x * z - w * y), 2.0 * (y * z + w * x)
    return out


class AttitudeInnovation:
    """One body's attitude innovation; `update` it with each pair of mocap and own attitude."""

    def __init__(self) -> None:
        self.innovation_rad = 0.0
        self.rate_rad_s = 0.0
        """Effective value of late, as the miss's."""
        self._bias: Tilt | None = None
        self._miss2 = self._rate2 = 0.0

    def update(self, mocap: Tilt, force_meas: Tilt, rate_rad_s: float, dt_s: float) -> Tilt:
        """Takes one moment in, dt_s after the last, at which it turns so fast; by how much they differ, x and y."""
        off = mocap[0] - force_meas[0], mocap[1] - force_meas[1]
        bias = self._bias or (_bounded(off[0]), _bounded(off[1]))
        slow, share = 1.0 - exp(-dt_s / BIAS_LAG_S), 1.0 - exp(-dt_s / LAG_S)
        innovation_rad = hypot(off[0] - bias[0], off[1] - bias[1])
        self._bias = (_bounded(bias[0] + slow * (off[0] - bias[0])), _bounded(bias[1] + slow * (off[1] - bias[1])))
        self._miss2 += share * (innovation_rad * innovation_rad - self._miss2)
        self._rate2 += share * (rate_rad_s * rate_rad_s - self._rate2)
        self.rate_rad_s = sqrt(self._rate2)
        self.innovation_rad = max(sqrt(self._miss2) - CLOCK_DOUBT_S * self.rate_rad_s, 0.0)
        return off


def _bounded(bias_rad: float) -> float:
    return min(max(bias_rad, -BIAS_MAX_RAD), BIAS_MAX_RAD)

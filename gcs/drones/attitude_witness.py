"""The mocap's attitudes held against the drones' own, moment by moment: poses that are older than they say disagree.

What a drone feels of gravity needs no camera. A constant difference is how the markers lie on it; one that comes and
goes as it turns is a delay that no stamp shows, and that the control cannot know of.
"""

from math import exp, hypot, sqrt

import numpy as np

from formation.maths.arrays import Quat
from formation.messages import LabFrame

KEPT = 64
BRACKET_NS = 60_000_000
GAP_S = 0.2
LAG_S, BIAS_LAG_S, BIAS_MAX_RAD = 0.2, 3.0, 0.1
CLOCK_DOUBT_S = 0.03
"""How far the two clocks, and the two ways of filtering, may be apart: what that makes of a turn is no miss."""


class AttitudeWitness:
    """For n bodies. miss_rad (n): how far the mocap's attitude is from what each feels; 0 where nothing is told."""

    def __init__(self, n: int) -> None:
        self.miss_rad = np.zeros(n)
        self._t_ns = np.full(KEPT, -(10**18), np.int64)
        self._down = np.full((KEPT, n, 2), np.nan)
        self._frames = 0
        self._waiting: list[tuple[int, float, float] | None] = [None] * n
        self._own: list[tuple[int, float, float] | None] = [None] * n
        self._bias: list[tuple[float, float] | None] = [None] * n
        self._miss2, self._rate2 = [0.0] * n, [0.0] * n

    def see(self, frame: LabFrame) -> None:
        """A frame came; stamps rise."""
        q, at = frame.q_lab_from_flu, self._frames % KEPT
        w, x, y, z = q[:, 0], q[:, 1], q[:, 2], q[:, 3]
        self._t_ns[at] = frame.t_capture_ns
        self._down[at, :, 0] = 2.0 * (x * z - w * y)
        self._down[at, :, 1] = 2.0 * (y * z + w * x)
        self._down[at, ~frame.seen] = np.nan
        self._frames += 1

    def hear(self, i: int, t_ns: int, q_lab_from_flu: Quat) -> None:
        """Body i told its own attitude of t_ns, our clock. It is judged when the next comes: the cameras are slower."""
        w, x, y, z = (float(part) for part in q_lab_from_flu)
        before, self._waiting[i] = self._waiting[i], (t_ns, 2.0 * (x * z - w * y), 2.0 * (y * z + w * x))
        if before is None or t_ns <= before[0]:
            return
        last, self._own[i] = self._own[i], before
        dt_s = 0.0 if last is None else (before[0] - last[0]) * 1e-9
        shown = self._shown(i, before[0])
        if last is None or shown is None or not 0.0 < dt_s < GAP_S:
            return
        off = shown[0] - before[1], shown[1] - before[2]
        rate = hypot(before[1] - last[1], before[2] - last[2]) / dt_s
        self._weigh(i, off, rate, dt_s)

    def _weigh(self, i: int, off: tuple[float, float], rate_rad_s: float, dt_s: float) -> None:
        bias = self._bias[i] or (_bounded(off[0]), _bounded(off[1]))
        slow, share = 1.0 - exp(-dt_s / BIAS_LAG_S), 1.0 - exp(-dt_s / LAG_S)
        missed = hypot(off[0] - bias[0], off[1] - bias[1])
        self._bias[i] = (_bounded(bias[0] + slow * (off[0] - bias[0])), _bounded(bias[1] + slow * (off[1] - bias[1])))
        self._miss2[i] += share * (missed * missed - self._miss2[i])
        self._rate2[i] += share * (rate_rad_s * rate_rad_s - self._rate2[i])
        self.miss_rad[i] = max(sqrt(self._miss2[i]) - CLOCK_DOUBT_S * sqrt(self._rate2[i]), 0.0)

    def _shown(self, i: int, t_ns: int) -> tuple[float, float] | None:
        """Gravity's direction in body i's axes, x and y, as the mocap shows it at t_ns; None where it does not."""
        order = np.arange(self._frames, self._frames + KEPT) % KEPT
        stamps = self._t_ns[order]
        after = int(np.searchsorted(stamps, t_ns))
        if after in (0, KEPT) or stamps[after] - stamps[after - 1] > BRACKET_NS:
            return None
        part = float(t_ns - stamps[after - 1]) / float(stamps[after] - stamps[after - 1])
        first, second = self._down[order[after - 1], i], self._down[order[after], i]
        x, y = (float(a + part * (b - a)) for a, b in zip(first, second, strict=True))
        return None if np.isnan(x + y) else (x, y)


def _bounded(bias_rad: float) -> float:
    return min(max(bias_rad, -BIAS_MAX_RAD), BIAS_MAX_RAD)

"""The mocap's attitudes held against the drones' own, moment by moment: poses that are older than they say disagree.

What a drone feels of gravity needs no camera. A constant difference is how the markers lie on it; one that comes and
goes as it turns is a delay that no stamp shows, and that the control cannot know of. One that comes and goes slowly is
an autopilot's idea of level that wanders, as PX4's does by half a degree: targets are put into its own idea (`told`).
"""

from collections import deque
from math import exp, hypot, sqrt

import numpy as np

from formation.maths.arrays import Quat
from formation.maths.frames import from_rotation_vector, multiply
from formation.messages import LabFrame

KEPT = 64
BRACKET_NS = 60_000_000
GAP_S = 0.2
LAG_S, BIAS_LAG_S, BIAS_MAX_RAD = 0.2, 3.0, 0.1
LEAN_LAG_S, LEAN_SURE_RAD, LEAN_MAX_RAD = 0.15, 2e-3, 0.05
CLOCK_DOUBT_S = 0.03
"""How far the two clocks, and the two ways of filtering, may be apart: what that makes of a turn is no miss."""


class AttitudeWitness:
    """For n bodies. miss_rad (n): how far the mocap's attitude is from what each feels; 0 where nothing is told."""

    def __init__(self, n: int) -> None:
        self.miss_rad = np.zeros(n)
        self._shown: deque[tuple[int, list[tuple[float, float] | None]]] = deque(maxlen=KEPT)
        self._waiting: list[tuple[int, float, float] | None] = [None] * n
        self._own: list[tuple[int, float, float] | None] = [None] * n
        self._bias: list[tuple[float, float] | None] = [None] * n
        self._miss2, self._rate2 = [0.0] * n, [0.0] * n
        self._lean: list[tuple[float, float]] = [(0.0, 0.0)] * n

    def see(self, frame: LabFrame) -> None:
        """A frame came; stamps rise."""
        poses = zip(frame.q_lab_from_flu.tolist(), frame.seen.tolist(), strict=True)
        self._shown.append((frame.t_capture_ns, [_down(q) if seen else None for q, seen in poses]))

    def hear(self, i: int, t_ns: int, q_lab_from_flu: Quat) -> None:
        """Body i told its own attitude of t_ns, our clock. It is judged when the next comes: the cameras are slower."""
        before, self._waiting[i] = self._waiting[i], (t_ns, *_down(q_lab_from_flu.tolist()))
        if before is None or t_ns <= before[0]:
            return
        last, self._own[i] = self._own[i], before
        dt_s = 0.0 if last is None else (before[0] - last[0]) * 1e-9
        shown = self._shown_at(i, before[0])
        if last is None or shown is None or not 0.0 < dt_s < GAP_S:
            return
        off = shown[0] - before[1], shown[1] - before[2]
        rate = hypot(before[1] - last[1], before[2] - last[2]) / dt_s
        self._weigh(i, off, rate, dt_s)

    def told(self, i: int, q_lab_from_flu: Quat) -> Quat:
        """What body i must be told to fly, so that the mocap sees this attitude; the same where it is not sure to lean.

        Within LEAN_MAX_RAD, and less by what noise, and by what the clocks' doubt makes of its turns.
        """
        x, y = self._lean[i]
        lean = hypot(x, y)
        sure = min(lean - max(LEAN_SURE_RAD, CLOCK_DOUBT_S * sqrt(self._rate2[i])), LEAN_MAX_RAD)
        if sure <= 0.0:
            return q_lab_from_flu
        return multiply(q_lab_from_flu, from_rotation_vector(np.array([-y, x, 0.0]) * (sure / lean)))

    def _weigh(self, i: int, off: tuple[float, float], rate_rad_s: float, dt_s: float) -> None:
        bias = self._bias[i] or (_bounded(off[0]), _bounded(off[1]))
        slow, share = 1.0 - exp(-dt_s / BIAS_LAG_S), 1.0 - exp(-dt_s / LAG_S)
        missed = hypot(off[0] - bias[0], off[1] - bias[1])
        self._bias[i] = (_bounded(bias[0] + slow * (off[0] - bias[0])), _bounded(bias[1] + slow * (off[1] - bias[1])))
        self._miss2[i] += share * (missed * missed - self._miss2[i])
        self._rate2[i] += share * (rate_rad_s * rate_rad_s - self._rate2[i])
        part, (x, y) = 1.0 - exp(-dt_s / LEAN_LAG_S), self._lean[i]
        self._lean[i] = x + part * (off[0] - x), y + part * (off[1] - y)
        self.miss_rad[i] = max(sqrt(self._miss2[i]) - CLOCK_DOUBT_S * sqrt(self._rate2[i]), 0.0)

    def _shown_at(self, i: int, t_ns: int) -> tuple[float, float] | None:
        """Gravity's direction in body i's axes, x and y, as the mocap shows it at t_ns; None where it does not."""
        after: tuple[int, list[tuple[float, float] | None]] | None = None
        for before in reversed(self._shown):
            if before[0] < t_ns:
                break
            after = before
        else:
            return None
        if after is None or after[0] - before[0] > BRACKET_NS:
            return None
        first, second = before[1][i], after[1][i]
        if first is None or second is None:
            return None
        part = (t_ns - before[0]) / (after[0] - before[0])
        return first[0] + part * (second[0] - first[0]), first[1] + part * (second[1] - first[1])


def _down(q_lab_from_flu: list[float]) -> tuple[float, float]:
    """Gravity's direction in the body's axes, x and y."""
    w, x, y, z = q_lab_from_flu
    return 2.0 * (x * z - w * y), 2.0 * (y * z + w * x)


def _bounded(bias_rad: float) -> float:
    return min(max(bias_rad, -BIAS_MAX_RAD), BIAS_MAX_RAD)

"""The mocap's attitudes held against the drones' own, moment by moment (formation.safety.attitude_miss).

A difference that comes and goes slowly is an autopilot's idea of level that wanders, as PX4's does by half a degree:
targets are put into its own idea (`told`).
"""

from collections import deque
from math import exp, hypot

import numpy as np

from formation.maths.arrays import Quat
from formation.maths.frames import from_rotation_vector, multiply
from formation.messages import LabFrame
from formation.safety.attitude_miss import CLOCK_DOUBT_S, GAP_S, AttitudeMiss, Tilt, tilt

KEPT = 64
BRACKET_NS = 60_000_000
LEAN_LAG_S, LEAN_SURE_RAD, LEAN_MAX_RAD = 0.15, 2e-3, 0.05


class AttitudeWitness:
    """For n bodies. miss_rad (n): how far the mocap's attitude is from what each feels; 0 where nothing is told."""

    def __init__(self, n: int) -> None:
        self.miss_rad = np.zeros(n)
        self._shown: deque[tuple[int, list[Tilt | None]]] = deque(maxlen=KEPT)
        self._waiting: list[tuple[int, float, float] | None] = [None] * n
        self._own: list[tuple[int, float, float] | None] = [None] * n
        self._miss = [AttitudeMiss() for _ in range(n)]
        self._lean: list[Tilt] = [(0.0, 0.0)] * n

    def see(self, frame: LabFrame) -> None:
        """A frame came; stamps rise."""
        poses = zip(frame.q_lab_from_flu.tolist(), frame.seen.tolist(), strict=True)
        self._shown.append((frame.t_capture_ns, [tilt(q) if seen else None for q, seen in poses]))

    def hear(self, i: int, t_ns: int, q_lab_from_flu: Quat) -> None:
        """Body i told its own attitude of t_ns, our clock. It is judged when the next comes: the cameras are slower."""
        before, self._waiting[i] = self._waiting[i], (t_ns, *tilt(q_lab_from_flu.tolist()))
        if before is None or t_ns <= before[0]:
            return
        last, self._own[i] = self._own[i], before
        dt_s = 0.0 if last is None else (before[0] - last[0]) * 1e-9
        shown = self._shown_at(i, before[0])
        if last is None or shown is None or not 0.0 < dt_s < GAP_S:
            return
        rate = hypot(before[1] - last[1], before[2] - last[2]) / dt_s
        off = self._miss[i].weigh(shown, before[1:], rate, dt_s)
        part, (x, y) = 1.0 - exp(-dt_s / LEAN_LAG_S), self._lean[i]
        self._lean[i] = x + part * (off[0] - x), y + part * (off[1] - y)
        self.miss_rad[i] = self._miss[i].miss_rad

    def told(self, i: int, q_lab_from_flu: Quat) -> Quat:
        """What body i must be told to fly, so that the mocap sees this attitude; the same where it is not sure to lean.

        Within LEAN_MAX_RAD, and less by what noise, and by what the clocks' doubt makes of its turns.
        """
        x, y = self._lean[i]
        lean = hypot(x, y)
        sure = min(lean - max(LEAN_SURE_RAD, CLOCK_DOUBT_S * self._miss[i].rate_rad_s), LEAN_MAX_RAD)
        if sure <= 0.0:
            return q_lab_from_flu
        return multiply(q_lab_from_flu, from_rotation_vector(np.array([-y, x, 0.0]) * (sure / lean)))

    def _shown_at(self, i: int, t_ns: int) -> Tilt | None:
        """Gravity's direction in body i's axes, x and y, as the mocap shows it at t_ns; None where it does not."""
        after: tuple[int, list[Tilt | None]] | None = None
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

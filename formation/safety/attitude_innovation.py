"""The mocap's attitudes of n bodies against those that they report: the direction of gravity in their axes.

*Innovation.* A body's own gravity direction needs no camera. A constant difference is the tilt of the marker frame. One
that grows while the drone turns is a delay which no stamp shows and the controller cannot know.
*Level bias.* A difference that changes slowly is the autopilot's, as PX4's half a degree. The last of the limits takes
it out of the targets. Pure: no frames, no clock.
"""

from dataclasses import dataclass
from math import exp, isnan, sqrt

import numpy as np
from numpy.typing import NDArray

from formation.maths.arrays import Bool, Float, Quats, Vec2
from formation.maths.copying import copy_into
from formation.maths.kernel import kernel
from formation.maths.records import Rows, blank
from formation.messages import LabFrame

LAG_S, BIAS_LAG_S, BIAS_MAX_RAD = 0.2, 3.0, 0.1
CLOCK_DOUBT_S = 0.03
"""How far the two clocks, and the two ways of filtering, may be apart: what that makes of a turn is no miss."""
MOST_RAD = 0.05
"""So great a miss, for a tenth of a second, is late poses'."""
GAP_S = 0.2
FRAMES_MAX = 64
BRACKET_NS = 60_000_000
LEVEL_BIAS_LAG_S, LEVEL_BIAS_MIN_RAD, LEVEL_BIAS_MAX_RAD = 0.15, 2e-3, 0.05
NEVER_NS = -(10**18)
Ints = NDArray[np.int64]


@dataclass(slots=True)
class Compared:
    """One body. A tilt (2) is gravity's direction in the body's axes, x and y; each with its time, our clock.

    pending: its own, newest, compared when the next has come: the cameras are slower. own: compared last. miss2, rate2:
    mean squares of late of what is missed and of the rate. marker_bias, level_bias: differences of late, slow and fast.
    """

    pending_ns: int
    pending: Vec2
    own_ns: int
    own: Vec2
    begun: bool
    marker_bias: Vec2
    level_bias: Vec2
    miss2: float
    rate2: float


class AttitudeMonitor:
    """Of n bodies. innovation_rad (n): the mocap's attitude less the drone's own; 0 where the drone reports none."""

    def __init__(self, n: int) -> None:
        self.innovation_rad = np.zeros(n)
        self._significant_bias_rad = np.zeros((n, 2))
        self._bodies = blank(Compared, n)
        self._bodies["pending_ns"][:] = self._bodies["own_ns"][:] = NEVER_NS
        self._frames_ns: Ints = np.full(FRAMES_MAX, NEVER_NS)
        self._tilts = np.full((FRAMES_MAX, n, 2), np.nan)
        self._count = 0

    def receive_frame(self, frame: LabFrame) -> None:
        """Add a frame; capture times rise."""
        at, self._count = self._count % FRAMES_MAX, self._count + 1
        self._frames_ns[at] = frame.t_capture_ns
        tilts(np.ascontiguousarray(frame.q_lab_from_flu), frame.seen, self._tilts[at])

    def receive_attitudes(self, which: Ints, t_ns: Ints, q_lab_from_flu: Quats) -> None:
        """Add own attitudes (k, 4) of bodies `which` (k), of t_ns (k), our clock; those of one body in order."""
        results = self.innovation_rad, self._significant_bias_rad
        _compare(self._bodies, self._frames_ns, self._tilts, self._count, which, t_ns, q_lab_from_flu, *results)

    def level_bias_rad(self, bodies: Ints) -> Float:
        """Gravity's direction in the x and y axes of these bodies (m), by the mocap less by themselves (m, 2).

        At most LEVEL_BIAS_MAX_RAD; what noise and the clocks' doubt can explain is left out.
        """
        significant: Float = self._significant_bias_rad[bodies]
        return significant


@kernel
def tilts(q_lab_from_flu: Quats, seen: Bool, out: Float) -> None:
    """Gravity's direction in the axes of bodies (n, 4), x and y, into out (n, 2); NaN of one that is not seen."""
    for i in range(len(q_lab_from_flu)):
        w, x, y, z = q_lab_from_flu[i, 0], q_lab_from_flu[i, 1], q_lab_from_flu[i, 2], q_lab_from_flu[i, 3]
        out[i, 0] = 2.0 * (x * z - w * y) if seen[i] else np.nan
        out[i, 1] = 2.0 * (y * z + w * x) if seen[i] else np.nan


@kernel
def _compare(
    bodies: Rows[Compared], frames_ns: Ints, frame_tilts: Float, count: int, which: Ints, t_ns: Ints, q: Quats,
    innovation_rad: Float, significant_bias_rad: Float,
) -> None:  # fmt: skip
    own, mocap = np.empty((len(which), 2)), np.empty(2)
    tilts(q, np.ones(len(which), np.bool_), own)
    for k in range(len(which)):
        i = which[k]
        body = bodies[i]
        last_ns, last_x, last_y = body.own_ns, body.own[0], body.own[1]
        at_ns, x, y = body.pending_ns, body.pending[0], body.pending[1]
        body.pending_ns = t_ns[k]
        copy_into(own[k], body.pending)
        if at_ns == NEVER_NS or t_ns[k] <= at_ns:
            continue
        body.own_ns = at_ns
        body.own[0], body.own[1] = x, y
        dt_s = (at_ns - last_ns) * 1e-9
        _mocap_tilt(i, at_ns, frames_ns, frame_tilts, count, mocap)
        if last_ns == NEVER_NS or isnan(mocap[0]) or not 0.0 < dt_s < GAP_S:
            continue
        turned_x, turned_y = x - last_x, y - last_y
        rate2 = (turned_x * turned_x + turned_y * turned_y) / (dt_s * dt_s)
        innovation_rad[i] = _update(body, mocap[0] - x, mocap[1] - y, rate2, dt_s)
        _significant(body, significant_bias_rad[i])


@kernel
def _update(body: Compared, off_x: float, off_y: float, rate2: float, dt_s: float) -> float:
    """The body's innovation once it differs by so much, dt_s after the last time, turning so fast (squared)."""
    slow, fast = 1.0 - exp(-dt_s / BIAS_LAG_S), 1.0 - exp(-dt_s / LEVEL_BIAS_LAG_S)
    share, miss2 = 1.0 - exp(-dt_s / LAG_S), 0.0
    for axis, off in enumerate((off_x, off_y)):
        bias = body.marker_bias[axis] if body.begun else _bounded(off)
        miss2 += (off - bias) * (off - bias)
        body.marker_bias[axis] = _bounded(bias + slow * (off - bias))
        body.level_bias[axis] += fast * (off - body.level_bias[axis])
    body.begun = True
    body.miss2 += share * (miss2 - body.miss2)
    body.rate2 += share * (rate2 - body.rate2)
    return max(sqrt(body.miss2) - CLOCK_DOUBT_S * sqrt(body.rate2), 0.0)


@kernel
def _significant(body: Compared, out: Float) -> None:
    """The level bias (2), less what noise and the clocks' doubt can explain."""
    x, y = body.level_bias[0], body.level_bias[1]
    bias_rad, doubt_rad = sqrt(x * x + y * y), CLOCK_DOUBT_S * sqrt(body.rate2)
    significant_rad = min(bias_rad - max(LEVEL_BIAS_MIN_RAD, doubt_rad), LEVEL_BIAS_MAX_RAD)
    share = significant_rad / bias_rad if significant_rad > 0.0 else 0.0
    out[0], out[1] = share * x, share * y


@kernel
def _mocap_tilt(i: int, t_ns: int, frames_ns: Ints, frame_tilts: Float, count: int, out: Float) -> None:
    """Body i's tilt (2) at t_ns as the frames on both sides show it; NaN where there are none, or one does not."""
    out[:] = np.nan
    for back in range(1, min(count, FRAMES_MAX)):
        before, after = (count - 1 - back) % FRAMES_MAX, (count - back) % FRAMES_MAX
        if frames_ns[before] < t_ns:
            if frames_ns[after] >= t_ns and frames_ns[after] - frames_ns[before] <= BRACKET_NS:
                part = (t_ns - frames_ns[before]) / (frames_ns[after] - frames_ns[before])
                for axis in range(2):
                    first, second = frame_tilts[before, i, axis], frame_tilts[after, i, axis]
                    out[axis] = first + part * (second - first)
            return


@kernel
def _bounded(bias_rad: float) -> float:
    return min(max(bias_rad, -BIAS_MAX_RAD), BIAS_MAX_RAD)

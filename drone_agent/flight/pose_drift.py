"""Whether a pose moves as the inertial sensors say: a drift of the pose is a kink in its offset from dead reckoning.

Dead reckoning that nothing puts right wanders, but smoothly: its offset from the poses is a line, bent by what the
accelerometer is wrong by. A pose that begins to slide kinks that line at once. Two fading-memory filters follow the
offset, a fast one of first degree and a slow one of second, which learns the bend; where their slopes part, it slides.
By a third, slower still, as it was half a second to a second before, the body is known for a while without its poses:
where they went wrong little by little, as late ones do, all three had believed them by then. Dead reckoning by an
accelerometer full of noise is worse than that: there it is the second, as it was a tenth of a second before. Poses that
are found late by how the body rises and falls (`drone_agent.flight.pose_lag`) slide as well.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

from drone_agent.flight.fading import first_degree, second_degree
from drone_agent.flight.pose_lag import PoseLag
from formation.model import Vec3Tuple

_FAST_1_S, _SLOW_1_S, _KEPT_1_S = 30.0, 8.0, 2.5
_MARK_NS, _YOUNG_NS = 500_000_000, 100_000_000
_NOISY_M_S = 0.05
"""A velocity that the accelerometer's noise makes wander by more within a second is reckoned on from lately."""
_APART_M_S = (0.04, 0.04, 0.12)
"""How far slopes may part: 0.37 of a slide that begins at once, 0.06 s after. The floor, as it is met, shakes the
vertical: samples of 5 ms tell but half of that."""
_SIGMAS, _NOISE_S = 5.5, 1.0
"""Of the slopes' noise where that is more: of the poses', learned in so long a time, and of what the sensors tell."""
_WALK_S = 0.02
"""Variance of the slopes' difference over the density of a velocity's random walk, simulated."""
_LATE_S, _LAG_S = 0.05, 0.15
"""Poses later than they say by up to so much lag behind by that times the velocity, and a little after: no slide."""
ALONE_NS = 5_000_000_000
"""After so long it is what is known from before that may be wrong, and all is learned anew: by then it has landed."""
_BACK_RATIO, _BACK_M = 1.0, 0.05
"""Slopes and places within which a pose is taken again."""
_SETTLED_NS, _RESETTLED_NS = 2_500_000_000, 500_000_000
"""So long a velocity and a bias that are not known yet take to be learned; and a velocity after a gap between poses."""
_GAP_S = 0.2
_AXES = range(3)
_NONE = (0.0, 0.0, 0.0)


class _Mark(NamedTuple):
    """What the slowest filter knew at a time."""

    t_ns: int
    curves: list[list[float]]


class PoseDrift:
    """Follows the offset of one body's poses from its dead reckoning."""

    def __init__(self) -> None:
        self.slides = False
        """Whether the newest pose moves as the inertial sensors say it does not."""
        self._since_ns: int | None = None
        self._gap_ns = -(2**62)
        self._t_ns = 0
        self._fast = [[0.0, 0.0] for _ in _AXES]
        self._slow = [[0.0, 0.0, 0.0] for _ in _AXES]
        self._kept = [[0.0, 0.0, 0.0] for _ in _AXES]
        self._marks: list[_Mark] = []
        self._young: list[_Mark] = []
        self._walk_m2_s3 = 0.0
        self._noise_m2 = 0.0
        self._fast_vel = [[0.0, 0.0] for _ in _AXES]
        self._slow_vel = [[0.0, 0.0, 0.0] for _ in _AXES]
        self._lag_m_s2 = [0.0, 0.0, 0.0]
        self._lag: PoseLag | None = None

    def begin(self, t_ns: int, offset_m: Sequence[float]) -> None:
        """Start anew at this offset: pose minus dead reckoning, along each axis of one frame."""
        self._since_ns, self._lag = t_ns, None
        self._kept = [[0.0, 0.0, 0.0] for _ in _AXES]
        self.place(t_ns, offset_m)

    def place(self, t_ns: int, offset_m: Sequence[float]) -> None:
        """Go on from this offset, with the slope that was known before the poses slid, or were not seen."""
        dt_s = (t_ns - self._t_ns) * 1e-9
        self.slides, self._t_ns = False, t_ns
        for axis in _AXES:
            bend = self._kept[axis][2]
            slope = self._kept[axis][1] + dt_s * bend
            self._fast[axis] = [offset_m[axis], slope]
            self._slow[axis] = [offset_m[axis], slope, bend]
            self._kept[axis] = [offset_m[axis], slope, bend]
        self._marks = [_Mark(t_ns, [[*curve] for curve in self._kept])]
        self._young = [*self._marks]

    def take(
        self, t_ns: int, offset_m: Sequence[float], vel_m_s: Sequence[float], walk_m2_s3: Sequence[float] = _NONE
    ) -> bool:
        """Take one pose in; whether it slides. What slides does not put the reckoning right.

        vel_m_s: as it is reckoned. walk_m2_s3: density of its random walk along each axis, variance over time, by the
        accelerometer's noise.
        """
        if self._since_ns is None:
            self.begin(t_ns, offset_m)
            return False
        if t_ns <= self._t_ns:
            return self.slides
        late = self._lags(t_ns, offset_m[2], vel_m_s[2], walk_m2_s3[2])
        dt_s = (t_ns - self._t_ns) * 1e-9
        if dt_s > _GAP_S and not self.slides and not late:
            self._gap_ns = t_ns
            self.place(t_ns, offset_m)
            return False
        self._t_ns = t_ns
        fast, slow, kept = (math.exp(-pole * dt_s) for pole in (_FAST_1_S, _SLOW_1_S, _KEPT_1_S))
        missed_m2, lag_kept = 0.0, math.exp(-dt_s / _LAG_S)
        for axis in _AXES:
            measured = None if self.slides else offset_m[axis]
            missed_m2 += first_degree(self._fast[axis], offset_m[axis], self._slow[axis][2], fast, dt_s) ** 2
            second_degree(self._slow[axis], measured, slow, dt_s)
            second_degree(self._kept[axis], measured, kept, dt_s)
            first_degree(self._fast_vel[axis], vel_m_s[axis], self._slow_vel[axis][2], fast, dt_s)
            second_degree(self._slow_vel[axis], vel_m_s[axis], slow, dt_s)
            lag_m_s2 = abs(self._fast_vel[axis][1] - self._slow_vel[axis][1])
            self._lag_m_s2[axis] = max(lag_m_s2, lag_kept * self._lag_m_s2[axis])
        if not self.slides:
            self._noise_m2 += (1.0 - math.exp(-dt_s / _NOISE_S)) * (missed_m2 / 3.0 - self._noise_m2)
        by_poses_m_s = math.sqrt(2.0 * ((1.0 - fast) / (1.0 + fast)) ** 3 * self._noise_m2) / dt_s
        self._walk_m2_s3 = max(walk_m2_s3)
        noise_m_s = [math.hypot(by_poses_m_s, math.sqrt(_WALK_S * walk)) for walk in walk_m2_s3]
        if self.slides:
            self.slides = late or self._ratio(self._kept, noise_m_s) > _BACK_RATIO or self._apart_m() > _BACK_M
        elif self._settled and (late or self._slopes_part(noise_m_s)):
            self.slides = self.step_back(t_ns)
            if late and self._lag is not None:
                self._kept[2], self._slow[2] = self._lag.on_time, self._lag.on_time
        else:
            self._mark(t_ns)
        return self.slides

    def _slopes_part(self, noise_m_s: list[float]) -> bool:
        return self._ratio(self._slow, noise_m_s) > 1.0 and self._t_ns - self._gap_ns >= _RESETTLED_NS

    def _lags(self, t_ns: int, offset_m: float, vel_m_s: float, walk_m2_s3: float) -> bool:
        if self._lag is None:
            self._lag = PoseLag(t_ns, offset_m, vel_m_s)
            return False
        return self._lag.take(t_ns, offset_m, vel_m_s, self._noise_m2, walk_m2_s3)

    def _mark(self, t_ns: int) -> None:
        if t_ns - self._marks[-1].t_ns >= _MARK_NS:
            self._marks = [self._marks[-1], _Mark(t_ns, [[*curve] for curve in self._kept])]
        if t_ns - self._young[-1].t_ns >= _YOUNG_NS:
            curves = [[slow[0], slow[1], kept[2]] for slow, kept in zip(self._slow, self._kept, strict=True)]
            self._young = [self._young[-1], _Mark(t_ns, curves)]

    def step_back(self, t_ns: int) -> bool:
        """Forget the last half to whole second: the poses had gone wrong by then. Whether enough was known before."""
        if not self._settled:
            return False
        mark = self._young[0] if math.sqrt(self._walk_m2_s3) > _NOISY_M_S else self._marks[0]
        self._kept = _carried(mark.curves, t_ns - mark.t_ns)
        self._slow, self._t_ns = [[*curve] for curve in self._kept], t_ns
        return True

    @property
    def _settled(self) -> bool:
        return self._since_ns is not None and self._t_ns - self._since_ns >= _SETTLED_NS

    def offset(self, t_ns: int) -> tuple[Vec3Tuple, Vec3Tuple]:
        """What dead reckoning is off by at a time, m and m/s, as it was before any slide."""
        (px, vx, _), (py, vy, _), (pz, vz, _) = _carried(self._kept, t_ns - self._t_ns)
        return (px, py, pz), (vx, vy, vz)

    def _ratio(self, curves: list[list[float]], noise_m_s: list[float]) -> float:
        """How far the fast slopes are from those, over what they may be."""
        x, y, z = (
            (fast[1] - curve[1]) / max(least, _SIGMAS * noise, _LATE_S * lag)
            for fast, curve, least, noise, lag in zip(
                self._fast, curves, _APART_M_S, noise_m_s, self._lag_m_s2, strict=True
            )
        )
        return max(math.hypot(x, y), abs(z))

    def _apart_m(self) -> float:
        """How far the poses have slid."""
        return math.hypot(*(fast[0] - curve[0] for fast, curve in zip(self._fast, self._kept, strict=True)))


def _carried(curves: list[list[float]], by_ns: int) -> list[list[float]]:
    dt_s = by_ns * 1e-9
    return [[p + dt_s * (v + 0.5 * dt_s * a), v + dt_s * a, a] for p, v, a in curves]

"""Detects pose drift: a kink in the offset between the poses and dead reckoning by the inertial sensors.

Uncorrected dead reckoning wanders smoothly: its offset from the poses is a line, bent by the accelerometer's bias. A
pose that begins to drift kinks that line at once. Two fading-memory filters follow the offset, a fast one of first
degree and a slow one of second, which learns the bend; where their slopes differ, the pose drifts. A third, slower
filter holds the state of half a second to a second before, from which the body is predicted without its poses: late
poses go wrong little by little, and the faster filters follow them. With a noisy accelerometer the second filter, as
of a tenth of a second before, takes its place. Poses that `drone_agent.flight.pose_lag` finds late count as drifting,
too.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

from drone_agent.flight.fading import first_degree, second_degree
from drone_agent.flight.pose_lag import PoseLag
from formation.model import Vec3Tuple

_FAST_1_S, _SLOW_1_S, _LONG_1_S = 30.0, 8.0, 2.5
_MARK_NS, _YOUNG_NS = 500_000_000, 100_000_000
_NOISY_M_S = 0.05
"""Above this random walk of the velocity in a second, dead reckoning starts from a newer mark."""
_SLOPE_DIFFERENCE_MAX_M_S = (0.04, 0.04, 0.12)
"""How far slopes may part: 0.37 of a slide that begins at once, 0.06 s after. The floor, as it is met, shakes the
vertical: samples of 5 ms show half of that."""
_SIGMAS, _NOISE_S = 5.5, 1.0
"""Of the slopes' noise where that is more: of the poses', learned in so long a time, and of the sensors'."""
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
        self.is_drifting = False
        """Whether the newest pose moves as the inertial sensors say it does not."""
        self._since_ns: int | None = None
        self._gap_ns = -(2**62)
        self._t_ns = 0
        self._fast = [[0.0, 0.0] for _ in _AXES]
        self._slow = [[0.0, 0.0, 0.0] for _ in _AXES]
        self._long = [[0.0, 0.0, 0.0] for _ in _AXES]
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
        self._long = [[0.0, 0.0, 0.0] for _ in _AXES]
        self.restart(t_ns, offset_m)

    def restart(self, t_ns: int, offset_m: Sequence[float]) -> None:
        """Continue from this offset, with the slope from before the pose drift or the gap."""
        dt_s = (t_ns - self._t_ns) * 1e-9
        self.is_drifting, self._t_ns = False, t_ns
        for axis in _AXES:
            bend = self._long[axis][2]
            slope = self._long[axis][1] + dt_s * bend
            self._fast[axis] = [offset_m[axis], slope]
            self._slow[axis] = [offset_m[axis], slope, bend]
            self._long[axis] = [offset_m[axis], slope, bend]
        self._marks = [_Mark(t_ns, [[*curve] for curve in self._long])]
        self._young = [*self._marks]

    def update(
        self, t_ns: int, offset_m: Sequence[float], vel_m_s: Sequence[float], walk_m2_s3: Sequence[float] = _NONE
    ) -> bool:
        """Receive one pose; returns whether it drifts. A drifting pose does not correct the dead reckoning.

        vel_m_s: the predicted velocity. walk_m2_s3: density of its random walk along each axis, variance over time,
        from the accelerometer's noise.
        """
        if self._since_ns is None:
            self.begin(t_ns, offset_m)
            return False
        if t_ns <= self._t_ns:
            return self.is_drifting
        late = self._lags(t_ns, offset_m[2], vel_m_s[2], walk_m2_s3[2])
        dt_s = (t_ns - self._t_ns) * 1e-9
        if dt_s > _GAP_S and not self.is_drifting and not late:
            self._gap_ns = t_ns
            self.restart(t_ns, offset_m)
            return False
        self._t_ns = t_ns
        fast, slow, long = (math.exp(-pole * dt_s) for pole in (_FAST_1_S, _SLOW_1_S, _LONG_1_S))
        innovation_m2, lag_decay = 0.0, math.exp(-dt_s / _LAG_S)
        for axis in _AXES:
            measured = None if self.is_drifting else offset_m[axis]
            innovation_m2 += first_degree(self._fast[axis], offset_m[axis], self._slow[axis][2], fast, dt_s) ** 2
            second_degree(self._slow[axis], measured, slow, dt_s)
            second_degree(self._long[axis], measured, long, dt_s)
            first_degree(self._fast_vel[axis], vel_m_s[axis], self._slow_vel[axis][2], fast, dt_s)
            second_degree(self._slow_vel[axis], vel_m_s[axis], slow, dt_s)
            lag_m_s2 = abs(self._fast_vel[axis][1] - self._slow_vel[axis][1])
            self._lag_m_s2[axis] = max(lag_m_s2, lag_decay * self._lag_m_s2[axis])
        if not self.is_drifting:
            self._noise_m2 += (1.0 - math.exp(-dt_s / _NOISE_S)) * (innovation_m2 / 3.0 - self._noise_m2)
        by_poses_m_s = math.sqrt(2.0 * ((1.0 - fast) / (1.0 + fast)) ** 3 * self._noise_m2) / dt_s
        self._walk_m2_s3 = max(walk_m2_s3)
        noise_m_s = [math.hypot(by_poses_m_s, math.sqrt(_WALK_S * walk)) for walk in walk_m2_s3]
        if self.is_drifting:
            self.is_drifting = late or self._ratio(self._long, noise_m_s) > _BACK_RATIO or self._drift_m() > _BACK_M
        elif self._settled and (late or self._slopes_part(noise_m_s)):
            self.is_drifting = self.step_back(t_ns)
            if late and self._lag is not None:
                self._long[2], self._slow[2] = self._lag.on_time, self._lag.on_time
        else:
            self._mark(t_ns)
        return self.is_drifting

    def _slopes_part(self, noise_m_s: list[float]) -> bool:
        return self._ratio(self._slow, noise_m_s) > 1.0 and self._t_ns - self._gap_ns >= _RESETTLED_NS

    def _lags(self, t_ns: int, offset_m: float, vel_m_s: float, walk_m2_s3: float) -> bool:
        if self._lag is None:
            self._lag = PoseLag(t_ns, offset_m, vel_m_s)
            return False
        return self._lag.update(t_ns, offset_m, vel_m_s, self._noise_m2, walk_m2_s3)

    def _mark(self, t_ns: int) -> None:
        if t_ns - self._marks[-1].t_ns >= _MARK_NS:
            self._marks = [self._marks[-1], _Mark(t_ns, [[*curve] for curve in self._long])]
        if t_ns - self._young[-1].t_ns >= _YOUNG_NS:
            curves = [[slow[0], slow[1], long[2]] for slow, long in zip(self._slow, self._long, strict=True)]
            self._young = [self._young[-1], _Mark(t_ns, curves)]

    def step_back(self, t_ns: int) -> bool:
        """Forget the last half to whole second: the poses had gone wrong by then. Whether enough was known before."""
        if not self._settled:
            return False
        mark = self._young[0] if math.sqrt(self._walk_m2_s3) > _NOISY_M_S else self._marks[0]
        self._long = _carried(mark.curves, t_ns - mark.t_ns)
        self._slow, self._t_ns = [[*curve] for curve in self._long], t_ns
        return True

    @property
    def _settled(self) -> bool:
        return self._since_ns is not None and self._t_ns - self._since_ns >= _SETTLED_NS

    def offset(self, t_ns: int) -> tuple[Vec3Tuple, Vec3Tuple]:
        """What dead reckoning is off by at a time, m and m/s, as it was before any slide."""
        (px, vx, _), (py, vy, _), (pz, vz, _) = _carried(self._long, t_ns - self._t_ns)
        return (px, py, pz), (vx, vy, vz)

    def _ratio(self, curves: list[list[float]], noise_m_s: list[float]) -> float:
        """How far the fast slopes are from those, over what they may be."""
        x, y, z = (
            (fast[1] - curve[1]) / max(least, _SIGMAS * noise, _LATE_S * lag)
            for fast, curve, least, noise, lag in zip(
                self._fast, curves, _SLOPE_DIFFERENCE_MAX_M_S, noise_m_s, self._lag_m_s2, strict=True
            )
        )
        return max(math.hypot(x, y), abs(z))

    def _drift_m(self) -> float:
        """How far the poses have drifted."""
        return math.hypot(*(fast[0] - curve[0] for fast, curve in zip(self._fast, self._long, strict=True)))


def _carried(curves: list[list[float]], by_ns: int) -> list[list[float]]:
    dt_s = by_ns * 1e-9
    return [[p + dt_s * (v + 0.5 * dt_s * a), v + dt_s * a, a] for p, v, a in curves]

"""Where a body is by its inertial sensors alone, and whether its mocap poses move as they say. No bytes, no clock.

    vel += dt (R f - g),  pos += dt vel,  R += R dt [rate]x,  offset = pose - pos

f: specific force, rate: of the body, both means that stand until the next; R is the pose's at every pose. Nothing puts
place and velocity right: what they are off by is `drone_agent.flight.pose_drift`'s to follow.
"""

from collections import deque
from math import exp
from typing import NamedTuple

import numpy as np

from drone_agent.flight.pose_drift import ALONE_NS, PoseDrift
from formation.maths.arrays import Quat, Vec3
from formation.maths.frames import from_rotation_vector, matrix, multiply, rotate
from formation.vehicle.body import GRAVITY_M_S2
from wire.link_messages.motion import FORCE_MOST_M_S2

_GRAVITY_LAB_M_S2 = np.array([0.0, 0.0, GRAVITY_M_S2])
_GAP_MAX_NS = 60_000_000
_SHAKEN_S = 0.25
_WAITING, _FELT = 32, 256


class Motion(NamedTuple):
    """Place and velocity in `lab`."""

    pos_lab_m: Vec3
    vel_lab_m_s: Vec3


class _Felt(NamedTuple):
    t_ns: int
    force_flu_m_s2: Vec3
    rate_flu_rad_s: Vec3


class _Seen(NamedTuple):
    t_ns: int
    pos_lab_m: Vec3
    q_lab_from_flu: Quat


class Reckoning:
    """One body. `feel` its inertial sensors and `see` its poses, each in order of time; either may be the later."""

    def __init__(self) -> None:
        self._drift = PoseDrift()
        self._felt: deque[_Felt] = deque(maxlen=_FELT)
        self._seen: deque[_Seen] = deque(maxlen=_WAITING)
        self._t_ns: int | None = None
        self._good_ns = 0
        self._q = np.array([1.0, 0.0, 0.0, 0.0])
        self._pos, self._vel = np.zeros(3), np.zeros(3)
        self._last: _Felt | None = None
        self._walk_flu_m2_s3 = np.zeros(3)

    @property
    def slides(self) -> bool:
        """Whether the poses move as the inertial sensors say the body does not."""
        return self._drift.slides

    def feel(self, t_ns: int, force_flu_m_s2: Vec3, rate_flu_rad_s: Vec3) -> None:
        """What was felt until t_ns, our clock. What no accelerometer shows, or comes out of order, is left out."""
        possible = float(np.abs(force_flu_m_s2).max()) <= FORCE_MOST_M_S2
        if possible and (self._last is None or t_ns > self._last.t_ns):
            felt = _Felt(t_ns, force_flu_m_s2, np.nan_to_num(rate_flu_rad_s))
            self._shake(felt)
            self._last = felt
            self._felt.append(felt)
            self._catch_up()

    def see(self, t_ns: int, pos_lab_m: Vec3, q_lab_from_flu: Quat) -> None:
        """A pose that was captured at t_ns."""
        if not self._seen or t_ns > self._seen[-1].t_ns:
            self._seen.append(_Seen(t_ns, pos_lab_m, q_lab_from_flu))
            self._catch_up()

    def at(self, t_ns: int) -> Motion:
        """Where it is, by the poses until they began to slide and by the inertial sensors since."""
        (place, rate), ahead_s = self._drift.offset(t_ns), (t_ns - (self._t_ns or t_ns)) * 1e-9
        return Motion(self._pos + ahead_s * self._vel + place, self._vel + rate)

    def _shake(self, felt: _Felt) -> None:
        """Learn from what differs between samples, by noise, vibration or a blow, what may be missed between them."""
        if self._last is None:
            return
        dt_s = (felt.t_ns - self._last.t_ns) * 1e-9
        change = felt.force_flu_m_s2 - self._last.force_flu_m_s2
        walk_m2_s3 = 0.5 * change * change * min(dt_s, _GAP_MAX_NS * 1e-9)
        self._walk_flu_m2_s3 += (1.0 - exp(-dt_s / _SHAKEN_S)) * (walk_m2_s3 - self._walk_flu_m2_s3)

    def _catch_up(self) -> None:
        """Hold every pose against what was felt until it was captured."""
        while self._seen and self._felt and self._seen[0].t_ns <= self._felt[-1].t_ns:
            seen = self._seen.popleft()
            alone = self.slides and seen.t_ns - self._good_ns > ALONE_NS
            if self._t_ns is None or alone or not self._carry_to(seen.t_ns):
                self._begin(seen)
                continue
            self._q = seen.q_lab_from_flu
            offset, walk = seen.pos_lab_m - self._pos, matrix(self._q) ** 2 @ self._walk_flu_m2_s3
            if not self._drift.take(seen.t_ns, offset.tolist(), self._vel.tolist(), walk.tolist()):
                self._good_ns = seen.t_ns

    def _begin(self, seen: _Seen) -> None:
        """Start anew where it is seen: its velocity is the offset's to learn."""
        self._t_ns, self._q = seen.t_ns, seen.q_lab_from_flu
        self._pos, self._vel = seen.pos_lab_m.copy(), np.zeros(3)
        while self._felt and self._felt[0].t_ns <= seen.t_ns:
            self._felt.popleft()
        self._drift.begin(seen.t_ns, (0.0, 0.0, 0.0))

    def _carry_to(self, t_ns: int) -> bool:
        """Reckon on to t_ns; whether the sensors told of all the time until then."""
        while self._felt and self._t_ns is not None and self._t_ns < t_ns:
            felt = self._felt[0]
            if felt.t_ns - self._t_ns > _GAP_MAX_NS:
                return False
            until_ns = min(felt.t_ns, t_ns)
            self._step(felt, (until_ns - self._t_ns) * 1e-9)
            self._t_ns = until_ns
            if felt.t_ns <= t_ns:
                self._felt.popleft()
        return True

    def _step(self, felt: _Felt, dt_s: float) -> None:
        half_turn = from_rotation_vector(0.5 * dt_s * felt.rate_flu_rad_s)
        halfway = multiply(self._q, half_turn)
        gain = dt_s * (rotate(halfway, felt.force_flu_m_s2) - _GRAVITY_LAB_M_S2)
        self._pos = self._pos + dt_s * (self._vel + 0.5 * gain)
        self._vel = self._vel + gain
        self._q = multiply(halfway, half_turn)

"""What a drone is sent while its pose is not believed: level flight for a moment, then nothing: it holds by itself.

A command made of poses that were wrong is worse than none: foreseen from a velocity that noise gave it, a hovering
drone of 40 g was led to 3 m/s within 0.3 s. Each drone's agent, or autopilot, flies by its own inertial sensors
meanwhile. A body that is only hidden is foreseen: what is known of it is right.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from formation.control.stack import Stages
from formation.maths.arrays import Scalars
from formation.maths.frames import from_yaw, yaw
from formation.messages import AttitudeTarget, LabFrame
from gcs.drones.drone import Drone

LEVEL_NS = 100_000_000
"""For so long one that is rejected is told to fly level; a setpoint acts as long again."""
SETTLED_NS = 200_000_000
"""For so long it must have been believed, without a gap, before it is led again: observers forget in that time."""


@dataclass(slots=True)
class _Sight:
    """Of one body: when it was last seen; since when its poses are in doubt, and until when they were (None: not)."""

    seen_ns: int = -(2**62)
    since_ns: int | None = None
    until_ns: int = 0

    def note(self, t_ns: int, seen: bool, rejected: bool) -> bool:
        """One frame more; whether it is the first to be believed again."""
        first = seen and self.since_ns is not None and self.until_ns > self.seen_ns
        if seen:
            self.seen_ns = t_ns
        if rejected and self.since_ns is None:
            self.since_ns = t_ns
        if self.since_ns is not None and not seen:
            self.until_ns = t_ns
        elif t_ns - self.until_ns >= SETTLED_NS:
            self.since_ns = None
        return first


class BlindFlight:
    """Whom the law leads, who is told to fly level, and who is told nothing."""

    def __init__(self, drones: Sequence[Drone], bodies: int, *, on: bool = True) -> None:
        """bodies: how many there are in a frame; on: else nothing is done."""
        self._drones, self._on = drones, on
        self._sights = [_Sight() for _ in range(bodies)]
        self._muted = [False] * len(drones)

    def mutes(self, i: int) -> bool:
        """Whether drone i is to be sent no setpoint."""
        return self._muted[i]

    def look(self, frame: LabFrame) -> list[int]:
        """Take a frame in; the bodies that it is the first to show again after poses that were wrong."""
        each = zip(self._sights, frame.seen.tolist(), frame.rejected.tolist(), strict=True)
        again = [i for i, (sight, seen, code) in enumerate(each) if sight.note(frame.t_capture_ns, seen, code > 0)]
        return again if self._on else []

    def kept(self, stages: Stages, t_ns: int, hover_thrust_norm: Scalars) -> Stages:
        """The stages of the frame last looked at as they are sent; themselves where no drone is in doubt."""
        target = stages.target
        for i, drone in enumerate(self._drones if self._on else ()):
            sight, flies = self._sights[drone.index], drone.lifted and not drone.touched
            doubted = sight.since_ns is not None
            levels = doubted and not (flies and t_ns - (sight.since_ns or 0) >= LEVEL_NS)
            self._muted[i] = doubted and not levels
            if levels:
                target = _level(target, i, float(hover_thrust_norm[i]))
        return stages if target is stages.target else replace(stages, target=target)


def _level(target: AttitudeTarget, i: int, hover_thrust_norm: float) -> AttitudeTarget:
    """Drone i level at its heading, with no more thrust than hovers."""
    q, rate, thrust = target.q_lab_from_flu.copy(), target.rate_flu_rad_s.copy(), target.thrust_norm.copy()
    q[i], rate[i], thrust[i] = from_yaw(np.array(yaw(q[i]))), 0.0, min(thrust[i], hover_thrust_norm)
    return replace(target, q_lab_from_flu=q, rate_flu_rad_s=rate, thrust_norm=thrust)

"""The limits on a finished target: the setpoint hold-off, then the correction for the autopilot's own level.

*Hold-off.* What a drone is sent while its pose is rejected: level flight for a moment, then nothing. A command computed
from wrong poses is worse than none: a hovering drone of 40 g was led to 3 m/s within 0.3 s by a velocity that was
noise. Each drone's guard, or autopilot, flies by its own inertial sensors meanwhile. A body that is only hidden is
predicted on: what is known of it is right.

*Level.* Each autopilot's own idea of level wanders, as PX4's does by half a degree: attitudes are sent in that one.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import cos, pi, sin, sqrt

import numpy as np

from formation.maths.arrays import Bool, Float, Quats, Scalars
from formation.maths.frames import from_yaw, yaw
from formation.maths.kernel import kernel
from formation.maths.quaternion import multiply_into
from formation.messages import AttitudeTarget, LabFrame

LEVEL_NS = 100_000_000
"""How long a drone whose pose is rejected is commanded level; its guard acts on the last setpoint as long again."""
SETTLED_NS = 200_000_000
"""How long its poses must have been accepted, without a gap, before it is led again: the observers' memory."""


@dataclass(slots=True)
class _Sight:
    """Of one body: when it was last seen; since when its poses are in doubt, and until when they were (None: not)."""

    seen_ns: int = -(2**62)
    since_ns: int | None = None
    until_ns: int = 0

    def update(self, t_ns: int, seen: bool, rejected: bool) -> bool:
        """Add a frame; whether it is the first to be accepted after rejected ones."""
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


class SetpointHoldOff:
    """Which drones the law leads, which are commanded level, and which are sent no setpoint."""

    def __init__(self, bodies: Sequence[int], count: int, *, on: bool = True) -> None:
        """bodies: index of each commanded vehicle among the `count` bodies of a frame; on: else nothing is held off."""
        self._bodies, self._on = tuple(bodies), on
        self._sights = [_Sight() for _ in range(count)]

    def receive(self, frame: LabFrame) -> list[int]:
        """Add a frame; the bodies that it is the first to show again after rejected poses."""
        each = zip(self._sights, frame.seen.tolist(), frame.rejected.tolist(), strict=True)
        again = [i for i, (sight, seen, code) in enumerate(each) if sight.update(frame.t_capture_ns, seen, code > 0)]
        return again if self._on else []

    def limit(self, target: AttitudeTarget, hover_thrust_norm: Scalars, flies: Bool) -> AttitudeTarget:
        """The target of the newest frame as it is sent; itself where no drone's pose is in doubt.

        hover_thrust_norm (m); flies (m): which drones are in the air, and so hold their place by themselves.
        """
        for i, body in enumerate(self._bodies if self._on else ()):
            since_ns = self._sights[body].since_ns
            if since_ns is None:
                continue
            if flies[i] and target.t_ns - since_ns >= LEVEL_NS:
                target = _held_off(target, i)
            else:
                target = _level(target, i, float(hover_thrust_norm[i]))
        return target


def _held_off(target: AttitudeTarget, i: int) -> AttitudeTarget:
    held_off = target.held_off.copy()
    held_off[i] = True
    return replace(target, held_off=held_off)


def _level(target: AttitudeTarget, i: int, hover_thrust_norm: float) -> AttitudeTarget:
    """Drone i level at its heading, with no more thrust than hovers."""
    q, rate, thrust = target.q_lab_from_flu.copy(), target.rate_flu_rad_s.copy(), target.thrust_norm.copy()
    q[i], rate[i], thrust[i] = from_yaw(np.array(yaw(q[i]))), 0.0, min(thrust[i], hover_thrust_norm)
    return replace(target, q_lab_from_flu=q, rate_flu_rad_s=rate, thrust_norm=thrust)


def correct_level(target: AttitudeTarget, bias_rad: Float) -> AttitudeTarget:
    """The target such that the mocap sees the attitudes asked for.

    bias_rad (m, 2): gravity's direction in each body's x and y axes by the mocap less that by the autopilot.
    """
    q_lab_from_flu = _corrected(np.ascontiguousarray(target.q_lab_from_flu), bias_rad)
    rest = target.rate_flu_rad_s, target.thrust_norm, target.saturation, target.held_off
    return AttitudeTarget(target.t_ns, q_lab_from_flu, *rest)


@kernel
def _corrected(q_lab_from_flu: Quats, bias_rad: Float) -> Quats:
    """q exp(r) of each attitude (m, 4), r = (-bias_y, bias_x, 0); itself where there is no bias."""
    corrected, turn = q_lab_from_flu.copy(), np.empty(4)
    for i in range(len(bias_rad)):
        x, y = -bias_rad[i, 1], bias_rad[i, 0]
        angle = sqrt(x * x + y * y)
        if angle == 0.0:
            continue
        half = 0.5 * angle
        rounded = pi * (half / pi)  # as numpy.sinc rounds it: recorded flights stay the same to the bit
        scale = 0.5 * (sin(rounded) / rounded)
        turn[0], turn[1], turn[2], turn[3] = cos(half), scale * x, scale * y, 0.0
        size = sqrt(turn[0] * turn[0] + turn[1] * turn[1] + turn[2] * turn[2])
        for k in range(3):
            turn[k] /= size
        multiply_into(q_lab_from_flu[i], turn, corrected[i])
    return corrected

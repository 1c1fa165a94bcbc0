"""A dead motor as an autopilot can tell it: by a body that turns as its motors were not told, or thrust not felt. Pure.

Not by an attitude that stays out of reach: a light vehicle with a dead motor has tumbled before that lasts, and a
sound one whose target leaps about is out of reach, too. What the motors were told, behind their lag, says how the body
should turn; what the gyro says besides is what a motor does not give. The thrust is ArduCopter's thrust-loss check:
with one motor dead the mixer gives up its opposite too, and half of the thrust is gone.
"""

from math import cos, hypot
from typing import NamedTuple

from drone_agent.simulation.airframe import Airframe
from formation.maths.quaternion import thrust_axis
from formation.vehicle.profile import GRAVITY_M_S2, VehicleProfile, VehicleState

LOOK_NS = 10_000_000
_GAP_NS = 3 * LOOK_NS
_LOST, _LOST_NS = 0.55, 40_000_000
"""Share of a motor's part in the thrust that its arm misses; with less than half left, a quadcopter cannot hover."""
_LEAST = 0.25
"""Of the weight: a motor's part is no less than a quarter of this."""
_OBEYS = 0.25
"""Share of the same: what turns so much as it was told obeys, however wrong its inertia is known."""
_SLIPS = 0.3
"""Of the rate that a motor's part would give in that time: so fast it must turn, as nothing on the floor does."""
_CARRIED = 0.5
"""Of the loss, felt as lift that was not told: a foot on the floor, no motor, turns it."""
_MISSING, _MISSING_NS = 0.35, 200_000_000
"""Share of the thrust asked for; an empty battery takes 0.15."""
_GIVES_GAIN, _GIVES_LEAST = 0.2, 0.2
_ASTRAY_COS, _SPIN_RAD_S, _ASTRAY_NS = cos(0.35), 3.0, 250_000_000
"""A sound loop is there by then, wherever it was told to go, and turns so fast no longer."""
_CORNERS = ((1.0, 1.0), (-1.0, -1.0), (-1.0, 1.0), (1.0, -1.0))
"""Whither, about x and y, the loss of each motor turns it: front right, rear left, front left, rear right."""


class Felt(NamedTuple):
    """Of one vehicle in `flu`: its rate about x and y, how that changes, and its specific force along z."""

    rate_rad_s: tuple[float, float]
    turn_rad_s2: tuple[float, float]
    lift_m_s2: float


class MotorFailure:
    """Watches one vehicle in the air; by its model, whose inertia may be off by a third."""

    def __init__(self, model: VehicleProfile) -> None:
        self._model = model
        self._before: tuple[int, VehicleState, list[float]] | None = None
        self._lost_since_ns: list[int | None] = [None] * 4
        self._missing_since_ns: int | None = None
        self._astray_since_ns: int | None = None
        self.gives = 1.0
        """Share of the thrust told, behind the motors' lag, that is felt; some 50 ms old."""
        self.fell = False
        """Whether it ever did in this flight."""

    def look(self, frame: Airframe) -> bool:
        """Whether a motor is dead; every LOOK_NS."""
        before, self._before = self._before, (frame.t_ns, frame.state, frame.told.tolist())
        if before is None or not 0 < frame.t_ns - before[0] <= _GAP_NS:
            self._lost_since_ns = [None] * 4
            return False
        dt_s = (frame.t_ns - before[0]) * 1e-9
        told_n = [(now - then) / dt_s for now, then in zip(frame.told[4:].tolist(), before[2][4:], strict=True)]
        return self.turns(frame.t_ns, told_n, felt(before[1], frame.state, dt_s))

    def turns(self, now_ns: int, told_n: list[float], felt: Felt) -> bool:
        """Whether the body turns as a dead motor makes it. told_n: (4) what each should have given since last time."""
        model, (fr, rl, fl, rr) = self._model, told_n
        told = (rl + fl - fr - rr, rl + rr - fr - fl)
        arms = [model.inertia_kg_m2[axis] / model.reach_m for axis in (0, 1)]
        turn = [arm * turn_rad_s2 for arm, turn_rad_s2 in zip(arms, felt.turn_rad_s2, strict=True)]
        all_n, felt_n = sum(told_n), felt.lift_m_s2 * model.mass_kg
        least_n = max(all_n, _LEAST * model.weight_n)
        part_n, carried_n = least_n / 4.0, felt_n - all_n
        self.gives += _GIVES_GAIN * (min(max(felt_n / least_n, _GIVES_LEAST), 1.0) - self.gives)
        dead = False
        for motor, signs in enumerate(_CORNERS):
            loss_n = min(sign * (turn[axis] - told[axis]) for axis, sign in enumerate(signs))
            obeys = any(
                sign * told[axis] > _OBEYS * part_n or sign * turn[axis] < -_OBEYS * part_n
                for axis, sign in enumerate(signs)
            )
            if loss_n < _LOST * part_n or obeys or carried_n > _CARRIED * loss_n:
                self._lost_since_ns[motor] = None
                continue
            since_ns = self._lost_since_ns[motor]
            since_ns = self._lost_since_ns[motor] = now_ns if since_ns is None else since_ns
            slips_n_s = min(sign * arms[axis] * felt.rate_rad_s[axis] for axis, sign in enumerate(signs))
            dead = dead or (now_ns - since_ns >= _LOST_NS and slips_n_s > _SLIPS * part_n * _LOST_NS * 1e-9)
        return dead

    def falls(self, now_ns: int, missing: float) -> bool:
        """Whether that share of its thrust has not been felt for too long; twenty times a second or more."""
        if missing < _MISSING:
            self._missing_since_ns = None
            return False
        if self._missing_since_ns is None:
            self._missing_since_ns = now_ns
        falls = now_ns - self._missing_since_ns >= _MISSING_NS
        self.fell = self.fell or falls
        return falls

    def astray(self, now_ns: int, frame: Airframe) -> bool:
        """Whether it turns, or leans elsewhere than it was told to, for longer than a sound one; with every `falls`.

        What is left of its motors does not hold it then.
        """
        wanted, is_so = thrust_axis(frame.setpoint.q_lab_from_flu), thrust_axis(frame.estimated_q_lab_from_flu)
        off_cos = sum(a * b for a, b in zip(wanted, is_so, strict=True))
        if off_cos >= _ASTRAY_COS and hypot(*frame.state.rate_flu_rad_s.tolist()) <= _SPIN_RAD_S:
            self._astray_since_ns = None
            return False
        self._astray_since_ns = self._astray_since_ns or now_ns
        return now_ns - self._astray_since_ns >= _ASTRAY_NS


def felt(before: VehicleState, after: VehicleState, dt_s: float) -> Felt:
    """What gyro and accelerometer told from one look to the next."""
    (p0, q0, _), (p1, q1, _) = before.rate_flu_rad_s.tolist(), after.rate_flu_rad_s.tolist()
    (ax, ay, az), (bx, by, bz) = thrust_axis(before.q_lab_from_flu), thrust_axis(after.q_lab_from_flu)
    x, y, z = ((after.vel_lab_m_s - before.vel_lab_m_s) / dt_s).tolist()
    lift = 0.5 * ((ax + bx) * x + (ay + by) * y + (az + bz) * (z + GRAVITY_M_S2))
    return Felt((p1, q1), ((p1 - p0) / dt_s, (q1 - q0) / dt_s), lift)

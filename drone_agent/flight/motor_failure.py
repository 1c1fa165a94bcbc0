"""Detects a dead motor as an autopilot can: by angular acceleration against the commands, or by missing thrust. Pure.

A large attitude error is no criterion: a light vehicle with a dead motor tumbles too soon, and a jumping target makes a
large error too. The commanded thrusts, behind the motors' lag, give the expected angular acceleration. The gyro's
difference from it is the missing thrust of one motor. The thrust criterion is ArduCopter's thrust-loss check: with one
motor dead the mixer reduces the opposite one too, and half of the thrust is gone.
"""

from math import cos, hypot
from typing import NamedTuple

from drone_agent.simulation.airframe import Airframe
from formation.maths.quaternion import thrust_axis
from formation.vehicle.profile import GRAVITY_M_S2, VehicleProfile, VehicleState

CHECK_PERIOD_NS = 10_000_000
_GAP_NS = 3 * CHECK_PERIOD_NS
_LOST, _LOST_NS = 0.55, 40_000_000
"""Share of a motor's part in the thrust that its arm misses; with less than half left, a quadcopter cannot hover."""
_LEAST = 0.25
"""Of the weight: a motor's part is no less than a quarter of this."""
_OBEYS = 0.25
"""Share of the same: a body that turns so much in the commanded direction obeys, whatever its inertia."""
_TURN_SHARE = 0.3
"""Of the rate that a motor's part would give in that time: so fast it must turn, as nothing on the floor does."""
_CARRIED = 0.5
"""Share of the loss, as measured lift above the commanded one: the floor pushes a foot, no motor failed."""
_MISSING, _MISSING_NS = 0.35, 200_000_000
"""Share of the thrust asked for; an empty battery takes 0.15."""
_SHARE_GAIN, _SHARE_MIN = 0.2, 0.2
_LOST_TILT_COS, _SPIN_RAD_S, _LOST_TILT_NS = cos(0.35), 3.0, 250_000_000
"""A working loop has reached any target by then, and no longer turns so fast."""
_CORNERS = ((1.0, 1.0), (-1.0, -1.0), (-1.0, 1.0), (1.0, -1.0))
"""Whither, about x and y, the loss of each motor turns it: front right, rear left, front left, rear right."""


class BodyResponse(NamedTuple):
    """Of one vehicle in `flu`: its rate about x and y, how that changes, and its specific force along z less drag."""

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
        self._attitude_lost_since_ns: int | None = None
        self.thrust_share = 1.0
        """Measured share of the commanded thrust, behind the motors' lag; some 50 ms old."""
        self.fell = False
        """Whether it ever did in this flight."""

    def check(self, frame: Airframe) -> bool:
        """Whether a motor is dead; every CHECK_PERIOD_NS."""
        before, self._before = self._before, (frame.t_ns, frame.state, frame.expected_thrust.tolist())
        if before is None or not 0 < frame.t_ns - before[0] <= _GAP_NS:
            self._lost_since_ns = [None] * 4
            return False
        dt_s = (frame.t_ns - before[0]) * 1e-9
        expected_n = [
            (now - then) / dt_s for now, then in zip(frame.expected_thrust[4:].tolist(), before[2][4:], strict=True)
        ]
        drag_1_s = self._model.drag_n_s_m[2] / self._model.mass_kg
        return self.turns(frame.t_ns, expected_n, body_response(before[1], frame.state, drag_1_s, dt_s))

    def turns(self, now_ns: int, expected_n: list[float], response: BodyResponse) -> bool:
        """Whether the body turns as with a dead motor. expected_n: (4) mean thrust of each since the last call."""
        model, (fr, rl, fl, rr) = self._model, expected_n
        expected_turn = (rl + fl - fr - rr, rl + rr - fr - fl)
        arms = [model.inertia_kg_m2[axis] / model.reach_m for axis in (0, 1)]
        turn = [arm * turn_rad_s2 for arm, turn_rad_s2 in zip(arms, response.turn_rad_s2, strict=True)]
        all_n, measured_n = sum(expected_n), response.lift_m_s2 * model.mass_kg
        least_n = max(all_n, _LEAST * model.weight_n)
        part_n, carried_n = least_n / 4.0, measured_n - all_n
        self.thrust_share += _SHARE_GAIN * (min(max(measured_n / least_n, _SHARE_MIN), 1.0) - self.thrust_share)
        dead = False
        (turn_x, turn_y), (expected_x, expected_y), obeyed_n = turn, expected_turn, _OBEYS * part_n
        for motor, (x, y) in enumerate(_CORNERS):
            loss_n = min(x * (turn_x - expected_x), y * (turn_y - expected_y))
            asked_n, countered_n = max(x * expected_x, y * expected_y), min(x * turn_x, y * turn_y)
            obeys = asked_n > obeyed_n or countered_n < -obeyed_n
            if loss_n < _LOST * part_n or obeys or carried_n > _CARRIED * loss_n:
                self._lost_since_ns[motor] = None
                continue
            since_ns = self._lost_since_ns[motor]
            since_ns = self._lost_since_ns[motor] = now_ns if since_ns is None else since_ns
            turn_n_s = min(x * arms[0] * response.rate_rad_s[0], y * arms[1] * response.rate_rad_s[1])
            dead = dead or (now_ns - since_ns >= _LOST_NS and turn_n_s > _TURN_SHARE * part_n * _LOST_NS * 1e-9)
        return dead

    def falls(self, now_ns: int, missing: float) -> bool:
        """Whether that share of its thrust has been missing for too long; call it twenty times a second or more."""
        if missing < _MISSING:
            self._missing_since_ns = None
            return False
        if self._missing_since_ns is None:
            self._missing_since_ns = now_ns
        falls = now_ns - self._missing_since_ns >= _MISSING_NS
        self.fell = self.fell or falls
        return falls

    def is_attitude_lost(self, now_ns: int, frame: Airframe) -> bool:
        """Whether it turns, or its tilt differs from the commanded one, for too long; call it with every `falls`.

        What is left of its motors does not hold it then.
        """
        wanted, is_so = thrust_axis(frame.setpoint.q_lab_from_flu), thrust_axis(frame.estimated_q_lab_from_flu)
        off_cos = sum(a * b for a, b in zip(wanted, is_so, strict=True))
        if off_cos >= _LOST_TILT_COS and hypot(*frame.state.rate_flu_rad_s.tolist()) <= _SPIN_RAD_S:
            self._attitude_lost_since_ns = None
            return False
        self._attitude_lost_since_ns = self._attitude_lost_since_ns or now_ns
        return now_ns - self._attitude_lost_since_ns >= _LOST_TILT_NS


def body_response(before: VehicleState, after: VehicleState, drag_1_s: float, dt_s: float) -> BodyResponse:
    """The response between two samples of gyro and accelerometer.

    drag_1_s: of the profile along z, deceleration per m/s; air that brakes a fall must not pass for thrust.
    """
    (p0, q0, _), (p1, q1, _) = before.rate_flu_rad_s.tolist(), after.rate_flu_rad_s.tolist()
    (ax, ay, az), (bx, by, bz) = thrust_axis(before.q_lab_from_flu), thrust_axis(after.q_lab_from_flu)
    x, y, z = ((after.vel_lab_m_s - before.vel_lab_m_s) / dt_s).tolist()
    vx, vy, vz = (0.5 * drag_1_s * (before.vel_lab_m_s + after.vel_lab_m_s)).tolist()
    lift = 0.5 * ((ax + bx) * (x + vx) + (ay + by) * (y + vy) + (az + bz) * (z + vz + GRAVITY_M_S2))
    return BodyResponse((p1, q1), ((p1 - p0) / dt_s, (q1 - q0) / dt_s), lift)

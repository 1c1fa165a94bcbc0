"""The autopilot's own position controller, and the guard's hold, which keeps a body over its place or lets it down.

P on position, PI on velocity, thrust vector to attitude and thrust. The formation's control law is the ground's.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from drone_agent.guard.estimate import BodyEstimate
from formation.maths.arrays import Quat, Vec3
from formation.maths.frames import IDENTITY, from_yaw, yaw
from formation.maths.quaternion import attitude_of, thrust_axis
from formation.model import Vec3Tuple
from formation.vehicle.body import GRAVITY_M_S2
from wire.link_messages import AttitudeSetpoint

_I_MAX_M_S2 = 3.0
_TILT_MAX = math.tan(0.45)
_LIFT_MIN_M_S2 = 0.3 * GRAVITY_M_S2
NO_RATE = np.zeros(3)
NO_RATE.setflags(write=False)


class Gains(NamedTuple):
    """Gains of one axis: from position to speed, from speed to acceleration and to its integral; the largest speed."""

    p_1_s: float
    p_vel_1_s: float
    i_vel_1_s2: float
    vel_max_m_s: float


_SIDEWAYS = Gains(p_1_s=1.2, p_vel_1_s=3.5, i_vel_1_s2=1.2, vel_max_m_s=1.5)
_UPWARDS = Gains(p_1_s=1.5, p_vel_1_s=5.0, i_vel_1_s2=2.0, vel_max_m_s=1.5)


class Belief(NamedTuple):
    """Where the autopilot thinks it is, in its own estimate's frame (`lab` if the external pose is right)."""

    pos_lab_m: Vec3Tuple
    vel_lab_m_s: Vec3Tuple
    yaw_rad: float


class LoopSetpoint:
    """The target of the attitude loop: attitude, body-rate feed-forward and collective thrust (0..1).

    target (8): the three in a row, as the kernel takes them; not to be changed.
    """

    __slots__ = ("target",)

    def __init__(self, q_lab_from_flu: Quat, rate_flu_rad_s: Vec3, thrust_norm: float) -> None:
        self.target = np.empty(8)
        self.target[0:4], self.target[4:7], self.target[7] = q_lab_from_flu, rate_flu_rad_s, thrust_norm

    @property
    def q_lab_from_flu(self) -> Quat:
        """Attitude."""
        return self.target[0:4]

    @property
    def rate_flu_rad_s(self) -> Vec3:
        """Body rate that is fed forward."""
        return self.target[4:7]

    @property
    def thrust_norm(self) -> float:
        """Collective thrust, 0..1."""
        return float(self.target[7])


class Demand(NamedTuple):
    """The motion to fly: a place, a speed or neither (level), a height or none (then `climb_m_s` alone), a heading."""

    yaw_rad: float
    pos_lab_m: tuple[float, float] | None = None
    speed_lab_m_s: tuple[float, float] | None = None
    height_m: float | None = None
    climb_m_s: float = 0.0
    attitude: Quat | None = None
    """Fly this attitude, only the vertical is the controller's."""


class PositionController:
    """One vehicle's loop; `step` at a steady rate, `reset` when it takes over."""

    def __init__(self, thrust_of: Callable[[float], float]) -> None:
        """thrust_of: the thrust_norm that gives a specific force, m/s^2."""
        self._thrust_of = thrust_of
        self._sum = [0.0, 0.0, 0.0]
        self.thrust_scale = 1.0
        """Delivered over modelled thrust, as far as it is known."""

    def reset(self, learnt_lab_m_s2: Vec3Tuple = (0.0, 0.0, 0.0)) -> None:
        """Forget what the integrators learnt, or begin with what is known already."""
        self._sum = list(learnt_lab_m_s2)

    def step(self, demand: Demand, belief: Belief, dt_s: float) -> LoopSetpoint:
        """Attitude and thrust that take the vehicle towards the demand."""
        ax, ay = self._sideways(demand, belief, dt_s)
        lift = max(self._upwards(demand, belief, dt_s) + GRAVITY_M_S2, _LIFT_MIN_M_S2)
        side = math.hypot(ax, ay)
        if side > _TILT_MAX * lift:
            ax, ay = ax * _TILT_MAX * lift / side, ay * _TILT_MAX * lift / side
        if demand.attitude is None:
            q = np.empty(4)
            attitude_of(ax, ay, lift, demand.yaw_rad, q)
            force = math.sqrt(ax * ax + ay * ay + lift * lift)
        else:
            q = demand.attitude
            force = lift / max(1.0 - 2.0 * float(q[1] * q[1] + q[2] * q[2]), 0.5)
        return LoopSetpoint(q, NO_RATE, self._thrust_of(force / self.thrust_scale))

    def _sideways(self, demand: Demand, belief: Belief, dt_s: float) -> tuple[float, float]:
        if demand.pos_lab_m is not None:
            pos = demand.pos_lab_m
            vel = [_SIDEWAYS.p_1_s * (pos[i] - belief.pos_lab_m[i]) for i in (0, 1)]
        elif demand.speed_lab_m_s is not None:
            vel = list(demand.speed_lab_m_s)
        else:
            return 0.0, 0.0
        speed = math.hypot(*vel)
        scale = min(1.0, _SIDEWAYS.vel_max_m_s / speed) if speed > 0.0 else 1.0
        x, y = (self._velocity_loop(i, scale * vel[i] - belief.vel_lab_m_s[i], _SIDEWAYS, dt_s) for i in (0, 1))
        return x, y

    def _upwards(self, demand: Demand, belief: Belief, dt_s: float) -> float:
        climb = demand.climb_m_s
        if demand.height_m is not None:
            climb += _UPWARDS.p_1_s * (demand.height_m - belief.pos_lab_m[2])
        climb = min(max(climb, -_UPWARDS.vel_max_m_s), _UPWARDS.vel_max_m_s)
        return self._velocity_loop(2, climb - belief.vel_lab_m_s[2], _UPWARDS, dt_s)

    def _velocity_loop(self, axis: int, error: float, gains: Gains, dt_s: float) -> float:
        total = self._sum[axis] + gains.i_vel_1_s2 * error * dt_s
        self._sum[axis] = min(max(total, -_I_MAX_M_S2), _I_MAX_M_S2)
        return gains.p_vel_1_s * error + self._sum[axis]


def warm_up() -> None:
    """Compile what `PositionController` calls: nothing compiles in flight."""
    attitude_of(0.0, 0.0, 1.0, 0.0, np.empty(4))


_TILT_ACC_MAX_M_S2 = 0.5
_TILT_AVERAGED_S = 0.25
_STOP_S = 0.4  # its place is where the present speed would come to rest
_SINK_M_S, _TOUCH_M_S, _SINK_S = 0.7, 0.27, 0.8  # PX4's MPC_LAND_SPEED; near the floor its height in so many seconds
_THRUST_LEAST = 0.85  # of what carries it, coming down: what stands in the air by a wrong pose must not fall
_OPEN_LOOP_THRUST, _OPEN_LOOP_S, _OPEN_LOOP_FADE_1_S = 0.95, 3.0, 0.3  # 1.5 m in 2.5 s, down at 1.2 m/s
_STILL_M = 0.05
"""A body at rest keeps within: by its place, since without an IMU the estimated velocity of a body at rest is noise."""
_STANDS_M, _STANDS_NS = 0.01, 500_000_000
"""A body that is let down and moves less in that time stands. In the air the least thrust lets it sink 0.18 m;
thrown up, it is within 1 cm of its highest for 0.3 s.
"""


class BodyHold:
    """One body, followed by its estimate. `note` what it is commanded; `begin`, then `step` at a steady rate.

    An autopilot's own hold is no better than its estimate, which indoors wanders by decimetres, and it may refuse:
    PX4's needs a position on the globe. Attitude targets it follows in the mode it is in, at once.
    """

    def __init__(self, estimate: BodyEstimate) -> None:
        self.stands = False
        """Whether it was let down and sinks no more."""
        self._estimate = estimate
        self._yaw_rad = 0.0
        self._hover_norm = estimate.hover_thrust_norm
        self._sink_norm: float | None = None
        """The thrust that carried it as it began to sink; None: it does not."""
        self._tilt_acc_lab_m_s2 = (0.0, 0.0)
        self._q_lab_from_flu: Quat = IDENTITY
        self._noted_ns = 0
        self._loop = PositionController(self._thrust_of)
        self._hold_xy_m = (0.0, 0.0)
        self._height_m = 0.0
        self._sunk_m, self._sunk_ns = 0.0, 0
        self._rest_lab_m: list[float] | None = None
        self._floor_m = math.nan
        """Its height as it stood on the floor; NaN where that was not seen."""
        self._open_loop_s = 0.0

    def update_rest(self, now_ns: int, *, armed: bool) -> bool:
        """Whether it is still where it came to rest, disarmed, which is on the floor; what moves comes to rest anew
        every _STILL_M."""
        motion = None if armed else self._estimate.motion(now_ns)
        if motion is None:
            self._rest_lab_m = None
            return False
        pos_lab_m = motion.pos_lab_m.tolist()
        self._floor_m = pos_lab_m[2]
        rests = self._rest_lab_m is None or math.dist(pos_lab_m, self._rest_lab_m) <= _STILL_M
        if self._rest_lab_m is None or not rests:
            self._rest_lab_m = pos_lab_m
        return rests

    @property
    def is_down(self) -> bool:
        """Whether it was let down and sinks no more, or an open-loop descent has reduced the thrust to zero."""
        return self.stands or self._open_loop_share() <= 0.0

    def note(self, target: AttitudeSetpoint, now_ns: int) -> None:
        """Receive a ground's setpoint: the hold keeps its heading and learns from its tilt what balances a wind."""
        self._q_lab_from_flu = target.q_lab_from_flu
        x, y, _ = thrust_axis(target.q_lab_from_flu)
        share = 1.0 - math.exp(-(now_ns - self._noted_ns) * 1e-9 / _TILT_AVERAGED_S)
        self._noted_ns = now_ns
        ax, ay = self._tilt_acc_lab_m_s2
        self._tilt_acc_lab_m_s2 = (ax + share * (GRAVITY_M_S2 * x - ax), ay + share * (GRAVITY_M_S2 * y - ay))

    def begin(self, now_ns: int) -> None:
        """Hold from here on, or where it would come to rest."""
        self._yaw_rad = float(yaw(self._q_lab_from_flu))
        ax, ay = (min(max(acc, -_TILT_ACC_MAX_M_S2), _TILT_ACC_MAX_M_S2) for acc in self._tilt_acc_lab_m_s2)
        self._loop.reset((ax, ay, 0.0))
        motion = self._estimate.motion(now_ns)
        x, y, z = (0.0, 0.0, 0.0) if motion is None else motion.pos_lab_m.tolist()
        vx, vy, _ = (0.0, 0.0, 0.0) if motion is None else motion.vel_lab_m_s.tolist()
        self._hold_xy_m = (x + _STOP_S * vx, y + _STOP_S * vy)
        self._height_m, self.stands = z, False
        self._sunk_m, self._sunk_ns = z, now_ns
        self._open_loop_s = 0.0
        self._sink_norm = None

    def step(self, now_ns: int, dt_s: float, *, down: bool) -> LoopSetpoint:
        """The next attitude and thrust. Level, with the thrust that carries it, before it was ever seen."""
        self._hover_norm = self._estimate.hover_thrust_norm
        motion = self._estimate.motion(now_ns)
        if motion is None:
            return self._loop.step(Demand(self._yaw_rad), Belief((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), self._yaw_rad), dt_s)
        x, y, z = motion.pos_lab_m.tolist()
        vx, vy, vz = motion.vel_lab_m_s.tolist()
        demand = Demand(self._yaw_rad, self._hold_xy_m, height_m=self._height_m)
        if not down or abs(self._sunk_m - z) > _STANDS_M:
            self._sunk_m, self._sunk_ns = z, now_ns
        if down:
            demand = Demand(self._yaw_rad, self._hold_xy_m, climb_m_s=-self._sink_m_s(z))
            self.stands = self.stands or now_ns - self._sunk_ns >= _STANDS_NS
        flown = self._loop.step(demand, Belief((x, y, z), (vx, vy, vz), self._yaw_rad), dt_s)
        least = _THRUST_LEAST * self._begin_to_sink() if down else 0.0
        if flown.thrust_norm < least:
            return LoopSetpoint(flown.q_lab_from_flu, flown.rate_flu_rad_s, least)
        return flown

    def _sink_m_s(self, z_m: float) -> float:
        """How fast to sink at that height: slower near the floor, and wherever the floor is not known."""
        return min(_SINK_M_S, max(_TOUCH_M_S, (z_m - self._floor_m) / _SINK_S))

    def descend_open_loop(self, dt_s: float) -> LoopSetpoint:
        """Down by attitude and thrust alone: level, a little less than what carries it, and none in the end."""
        self._open_loop_s += dt_s
        thrust = self._open_loop_share() * self._begin_to_sink()
        return LoopSetpoint(from_yaw(np.array(self._yaw_rad)), NO_RATE, thrust)

    def _begin_to_sink(self) -> float:
        """The least that carried it since: motors that give all again would throw it up."""
        now = self._estimate.hover_thrust_norm
        self._sink_norm = now if self._sink_norm is None else min(self._sink_norm, now)
        return self._sink_norm

    def _open_loop_share(self) -> float:
        return max(_OPEN_LOOP_THRUST - _OPEN_LOOP_FADE_1_S * max(self._open_loop_s - _OPEN_LOOP_S, 0.0), 0.0)

    def _thrust_of(self, force_m_s2: float) -> float:
        return min(max(self._hover_norm * force_m_s2 / GRAVITY_M_S2, 0.0), 1.0)

"""Flies one task at a time by the agent's own position controller: level, hold, take off, return, land, descend."""

import numpy as np

from drone_agent.autopilots.model import Task, Timing
from drone_agent.guard.position import NO_RATE, Belief, Demand, LoopSetpoint, PositionController
from formation.maths.arrays import Quat
from formation.maths.frames import from_yaw
from formation.model import Vec3Tuple
from formation.vehicle.profile import VehicleProfile

_LANDINGS = (Task.LAND, Task.DESCEND)
_STOP_S = 0.3  # a hold's place is where the present speed would come to rest
_LEAD_M = 0.4  # how far the height asked for may run ahead of the vehicle
_ARRIVED_M = 0.08
_RISE_M, _RISE_M_S = 0.1, 0.1
_TOUCH_CLIMB_M_S = 0.12
_TOUCH_S = 0.3
_CARRIED_S = 1.0  # what the floor carries for this long stands on it, whatever the estimate says
_CUT_1_S = 3.0  # after touch-down the thrust fades in a third of a second
_LATE_S, _LATE_M_S2, _LATE_MAX_M_S = 3.0, 0.3, 0.7  # a landing that takes this much too long sinks faster and faster


class Pilot:
    """The task in hand and its references; `begin` a task, then `step` at a steady rate."""

    def __init__(self, profile: VehicleProfile) -> None:
        self.task = Task.OFF
        self._rest_m = 0.0
        self._sinking_s = self._due_s = 0.0
        self._carried_s = 0.0
        self._loop = PositionController(lambda force_m_s2: profile.thrust_norm_of(profile.mass_kg * force_m_s2))
        self._hold_xy_m: tuple[float, float] = (0.0, 0.0)
        self._home: tuple[float, float] = (0.0, 0.0)
        self._height_m = self._goal_m = 0.0
        self._yaw_rad = 0.0
        self._attitude: Quat | None = None
        self._velocity: Vec3Tuple | None = None
        self._climb_m_s = 0.0
        self._touch_s = 0.0
        self._thrust = 1.0

    def begin(self, task: Task, belief: Belief, *, goal_m: float | None = None) -> None:
        """Take the task up from where the vehicle is; goal_m: the height of a take-off or a return.

        A hold that follows a take-off keeps the place and height the take-off was for.
        """
        if self.task not in (Task.LEVEL, Task.HOLD, Task.TAKEOFF, Task.RETURN, Task.LAND):
            self._loop.reset()
        x, y, z = belief.pos_lab_m
        vx, vy, _ = belief.vel_lab_m_s
        if (self.task, task) != (Task.TAKEOFF, Task.HOLD):
            self._hold_xy_m = (x + _STOP_S * vx, y + _STOP_S * vy)
            self._height_m, self._goal_m = z, z if goal_m is None else goal_m
            self._yaw_rad = belief.yaw_rad
        if task not in _LANDINGS or self.task not in _LANDINGS:
            self._sinking_s = self._due_s = 0.0
        self.task = task
        self._attitude, self._velocity, self._climb_m_s = None, None, 0.0
        self._touch_s, self._carried_s, self._thrust = 0.0, 0.0, 1.0

    def set_thrust_scale(self, thrust_scale: float) -> None:
        """From now on the motors deliver so much of the thrust that the profile says."""
        self._loop.thrust_scale = thrust_scale

    def set_home(self, belief: Belief) -> None:
        """Return comes back here."""
        self._home = (belief.pos_lab_m[0], belief.pos_lab_m[1])
        self._rest_m = belief.pos_lab_m[2]

    def go_to(self, goal_lab_m: Vec3Tuple, yaw_rad: float | None) -> None:
        """Hold there instead."""
        self._hold_xy_m, self._goal_m, self._velocity = goal_lab_m[:2], goal_lab_m[2], None
        if yaw_rad is not None:
            self._yaw_rad = yaw_rad

    def drift(self, vel_lab_m_s: Vec3Tuple, yaw_rad: float | None) -> None:
        """Move at this velocity until the next."""
        self._velocity = vel_lab_m_s
        if yaw_rad is not None:
            self._yaw_rad = yaw_rad

    def follow(self, attitude: Quat, climb_m_s: float) -> None:
        """Fly this attitude and climb rate until the next (ArduPilot's reading of an attitude target)."""
        self._attitude, self._climb_m_s = attitude, climb_m_s

    @property
    def asks_to_rise(self) -> bool:
        """Whether the task would leave the ground."""
        if self._attitude is not None:
            return self._climb_m_s > 0.0
        if self._velocity is not None:
            return self._velocity[2] > _RISE_M_S
        return self.task is Task.TAKEOFF or self._goal_m > self._height_m + _RISE_M

    def arrived(self, belief: Belief) -> bool:
        """Whether a take-off has reached its height, or a return its place."""
        if self.task is Task.RETURN:
            return all(abs(p - h) < 0.15 for p, h in zip(belief.pos_lab_m, self._home, strict=False))
        return abs(self._goal_m - belief.pos_lab_m[2]) < _ARRIVED_M

    def idle(self) -> LoopSetpoint:
        """Level with the motors at rest: armed on the ground."""
        self._loop.reset()
        return LoopSetpoint(from_yaw(np.array(self._yaw_rad)), NO_RATE, 0.0)

    @property
    def faded(self) -> bool:
        """Whether a landing has taken the thrust away."""
        return self._thrust == 0.0

    def step(self, belief: Belief, timing: Timing, dt_s: float, *, carried: bool = False) -> LoopSetpoint:
        """The next attitude and thrust; carried: by the floor, as drone_agent.flight.landing senses it."""
        demand = self._demand(belief, timing, dt_s)
        setpoint = self._loop.step(demand, belief, dt_s)
        if self.task in _LANDINGS:
            return self._touch_down(setpoint, belief, carried, dt_s)
        return setpoint

    def _demand(self, belief: Belief, timing: Timing, dt_s: float) -> Demand:
        yaw = self._yaw_rad
        if self._attitude is not None:
            return Demand(yaw, climb_m_s=self._climb_m_s, attitude=self._attitude)
        if self._velocity is not None:
            return Demand(yaw, speed_lab_m_s=self._velocity[:2], climb_m_s=self._velocity[2])
        if self.task is Task.DESCEND:
            return Demand(yaw, climb_m_s=-self._sink_m_s(belief, timing, dt_s))
        if self.task is Task.LAND:
            return Demand(yaw, self._hold_xy_m, climb_m_s=-self._sink_m_s(belief, timing, dt_s))
        if self.task is Task.LEVEL:
            return Demand(yaw, height_m=self._height_m)
        climb = self._climb_reference(belief, timing, dt_s)
        xy_m = self._home if self.task is Task.RETURN else self._hold_xy_m
        return Demand(yaw, xy_m, height_m=self._height_m, climb_m_s=climb)

    def _climb_reference(self, belief: Belief, timing: Timing, dt_s: float) -> float:
        """Move the height asked for towards the goal; returns its speed, m/s."""
        left = self._goal_m - self._height_m
        step = min(max(left, -timing.climb_m_s * dt_s), timing.climb_m_s * dt_s)
        if abs(self._height_m + step - belief.pos_lab_m[2]) > _LEAD_M:
            return 0.0
        self._height_m += step
        return step / dt_s

    def _sink_m_s(self, belief: Belief, timing: Timing, dt_s: float) -> float:
        """How fast to come down: by the autopilot's own parameter.

        Every landing ends: one that has taken longer than its height says has an estimate that is wrong.
        """
        height_m = belief.pos_lab_m[2] - self._rest_m
        if self._due_s == 0.0:
            self._due_s = max(height_m, 0.0) / timing.land_m_s + _LATE_S
        self._sinking_s += dt_s
        late_s = self._sinking_s - self._due_s
        if late_s > 0.0:
            return timing.land_m_s + min(_LATE_M_S2 * late_s, _LATE_MAX_M_S)
        return timing.land_m_s

    def _touch_down(self, setpoint: LoopSetpoint, belief: Belief, carried: bool, dt_s: float) -> LoopSetpoint:
        """On the floor, which carries it, the descent stops though it is still asked for: then fade the thrust out."""
        still = abs(belief.vel_lab_m_s[2]) < _TOUCH_CLIMB_M_S
        self._touch_s = self._touch_s + dt_s if still and carried else 0.0
        self._carried_s = self._carried_s + dt_s if carried else 0.0
        if self._touch_s > _TOUCH_S or self._carried_s > _CARRIED_S:
            self._thrust = max(self._thrust - _CUT_1_S * dt_s, 0.0)
        else:
            self._thrust = 1.0
        return LoopSetpoint(setpoint.q_lab_from_flu, setpoint.rate_flu_rad_s, self._thrust * setpoint.thrust_norm)

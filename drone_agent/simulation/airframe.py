"""The true vehicle in the true air: physics on an exact grid of 1 kHz, the setpoints that reach it, its pack.

The grid starts at construction and never depends on when anybody asks: a state between grid points is a side
step that leaves the grid alone, so that two hosts that ask at different times fly the same flight.
"""

from collections import deque

import numpy as np

from drone_agent.simulation.attitude_loop import WHOLE_MOTORS, LoopSetpoint
from drone_agent.simulation.battery import BatteryPack
from drone_agent.simulation.disturbance import Disturbance, acceleration
from drone_agent.simulation.inertial import InertialSensor
from drone_agent.simulation.level_error import AttitudeBias
from drone_agent.simulation.physics import OWN, Physics
from formation.maths.arrays import Float, Quat, Vec3
from formation.maths.frames import from_yaw
from formation.vehicle.profile import VehicleProfile, VehicleState, at_rest

_GUST_STEPS = 5  # the air acts anew this often


class Airframe:
    """One vehicle; `advance_to` moves its grid, `state_at` only looks."""

    def __init__(
        self,
        profile: VehicleProfile,
        air: Disturbance,
        start_lab_m: Vec3,
        start_yaw_rad: float,
        t0_ns: int,
        attitude_bias: AttitudeBias | None = None,
        physics: Physics = OWN,
    ) -> None:
        """attitude_bias: of its autopilot's level estimate, None: none; physics: what integrates it."""
        self.profile = profile
        self.pack = BatteryPack(profile.battery)
        self.armed = False
        self.motor_gain: Float = WHOLE_MOTORS
        """(4) Each motor's share of its commanded thrust; 0 of a dead one."""
        self.expected_thrust: Float = np.zeros(8)
        """What the autopilot knows of its motors: see `drone_agent.simulation.attitude_loop.advance`."""
        self.inertial: InertialSensor | None = None
        """Receives the states at its own rhythm, where there is one."""
        self.t_ns = t0_ns
        self.state: VehicleState = at_rest(start_lab_m, from_yaw(np.array(start_yaw_rad)))
        self.setpoint = LoopSetpoint(self.state.q_lab_from_flu, np.zeros(3), 0.0)
        self._air = air
        self._gusty = air.fan is not None
        self._attitude_bias = attitude_bias
        self._physics = physics
        self._t0_ns = t0_ns
        self._push = self._disturbance()
        self._coming: deque[tuple[int, LoopSetpoint]] = deque()

    def order(self, t_ns: int, setpoint: LoopSetpoint) -> None:
        """Let `setpoint` reach the attitude loop at `t_ns`, after those ordered before it."""
        self._coming.append((t_ns, setpoint))

    def order_now(self, setpoint: LoopSetpoint) -> None:
        """Let `setpoint` rule from the grid's present on; what was on its way is forgotten."""
        self._coming.clear()
        self.setpoint = setpoint

    def advance_to(self, now_ns: int) -> None:
        """Integrate up to the last grid point at or before `now_ns`."""
        step_ns = self._physics.step_ns
        gust_ns = _GUST_STEPS * step_ns
        while now_ns - self.t_ns >= step_ns:
            end_ns = now_ns
            while self._coming:
                due_ns, setpoint = self._coming[0]
                if due_ns > self.t_ns:
                    end_ns = min(end_ns, due_ns + step_ns - 1)
                    break
                self.setpoint = setpoint
                self._coming.popleft()
            if self._gusty:
                since_ns = (self.t_ns - self._t0_ns) % gust_ns
                if since_ns == 0:
                    self._push = self._disturbance()
                end_ns = min(end_ns, self.t_ns + gust_ns - since_ns)
            if self._attitude_bias is not None:
                self._attitude_bias.advance_to(self.t_ns)
                end_ns = min(end_ns, self._attitude_bias.next_ns)
            if self.inertial is not None:
                end_ns = min(end_ns, self.inertial.next_ns(self.t_ns, step_ns))
            steps = max((end_ns - self.t_ns) // step_ns, 1)
            self.state = self._integrated(step_ns * 1e-9, steps, self.expected_thrust)
            self.t_ns += steps * step_ns
            if self.inertial is not None:
                self.inertial.note(self.t_ns, self.state)

    def state_at(self, now_ns: int) -> VehicleState:
        """The state at `now_ns`, at most one step past the grid's present, which does not move."""
        self.advance_to(now_ns)
        rest_ns = now_ns - self.t_ns
        return self._integrated(rest_ns * 1e-9, 1) if rest_ns > 0 else self.state

    @property
    def estimated_q_lab_from_flu(self) -> Quat:
        """The present attitude as the autopilot has it."""
        q = self.state.q_lab_from_flu
        return q if self._attitude_bias is None else self._attitude_bias.estimated(q)

    @property
    def push_lab_m_s2(self) -> Vec3:
        """What the air does to the vehicle: acceleration in `lab`."""
        return self._push

    def drain(self, dt_s: float) -> None:
        """Take `dt_s` at the present thrust out of the pack."""
        self.pack.drain(sum(self.state.motor_thrust_n.tolist()) / self.profile.weight_n, dt_s)

    def _integrated(self, dt_s: float, steps: int, expected_thrust: Float | None = None) -> VehicleState:
        scale = self.pack.thrust_scale
        setpoint = self.setpoint
        if self._attitude_bias is not None:
            attitude = self._attitude_bias.true(setpoint.q_lab_from_flu)
            setpoint = LoopSetpoint(attitude, setpoint.rate_flu_rad_s, setpoint.thrust_norm)
        gain = self.motor_gain
        return self._physics.advance(
            self.state, self.profile, setpoint, self.armed, self._push, dt_s, steps, scale, gain, expected_thrust
        )

    def _disturbance(self) -> Vec3:
        x, y, z = self.state.pos_lab_m.tolist()
        return np.array(acceleration(self._air, (self.t_ns - self._t0_ns) * 1e-9, (x, y, z), self.profile.reach_m))

"""The true vehicle in the true air: physics on an exact grid of 1 kHz, the setpoints that reach it, its pack.

The grid starts at construction and never depends on when anybody asks: a state between grid points is a side
step that leaves the grid alone, so that two hosts that ask at different times fly the same flight.
"""

from collections import deque
from collections.abc import Sequence
from typing import Protocol

import numpy as np

from drone_agent.flight.vehicle import ImuSample
from drone_agent.guard.position import LoopSetpoint
from drone_agent.simulation.attitude_loop import OWN, WHOLE_MOTORS, Physics, turn_target
from drone_agent.simulation.battery import BatteryPack
from drone_agent.simulation.disturbance import Disturbance, push_into
from drone_agent.simulation.inertial import WINDOW_NS, InertialSensor
from formation.maths.arrays import Float, Quat, Vec3
from formation.maths.frames import IDENTITY, from_yaw
from formation.vehicle.profile import VehicleProfile, VehicleState, at_rest
from formation.vehicle.rigid_body import downwash_into

_FIX_NS = 4 * WINDOW_NS


class Reader(Protocol):
    """The autopilot, as its sensors know it."""

    def receive_sample(self, sample: ImuSample) -> Quat:
        """A sample is there; returns the attitude estimate."""
        ...

    def receive_fix(self, t_ns: int, pos_lab_m: Vec3, q_lab_from_flu: Quat) -> None:
        """A position and heading of its own receiver and compass."""
        ...


class Sensors:
    """Of one vehicle that is in `state` at t0_ns."""

    def __init__(
        self, inertial: InertialSensor, reader: Reader, t0_ns: int, state: VehicleState, *, has_receiver: bool
    ) -> None:
        """has_receiver: a simulated GNSS receiver and a compass, exact, at 50 Hz."""
        self._inertial, self._reader, self._has_receiver = inertial, reader, has_receiver
        self._t0_ns = self._t_ns = t0_ns
        self.next_ns = t0_ns + WINDOW_NS
        self._state = state
        self.newest: ImuSample | None = None

    def sample(self, t_ns: int, state: VehicleState) -> Quat:
        """The vehicle is in `state` at t_ns, at next_ns or just after. Returns the autopilot's attitude estimate."""
        sample = self._inertial.sample(self._state, state, t_ns, (t_ns - self._t_ns) * 1e-9)
        self.newest, self._t_ns, self._state = sample, t_ns, state
        q_estimated = self._reader.receive_sample(sample)
        if self._has_receiver and (self.next_ns - self._t0_ns) % _FIX_NS == 0:
            self._reader.receive_fix(t_ns, state.pos_lab_m, state.q_lab_from_flu)
        self.next_ns = t_ns + WINDOW_NS - (t_ns - self._t0_ns) % WINDOW_NS
        return q_estimated


_GUST_STEPS = 5  # the air acts anew this often


class Airframe:
    """One vehicle; `advance_to` moves its grid, `state_at` only looks."""

    link_loss = 0.0

    def __init__(
        self,
        profile: VehicleProfile,
        air: Disturbance,
        start_lab_m: Vec3,
        start_yaw_rad: float,
        t0_ns: int,
        inertial: InertialSensor,
        reader: Reader,
        physics: Physics = OWN,
        *,
        has_receiver: bool = False,
    ) -> None:
        """reader: its autopilot; physics: what integrates it; has_receiver: of positions of its own."""
        self.profile = profile
        self.pack = BatteryPack(profile.battery)
        self.armed = False
        self.motor_gain: Float = WHOLE_MOTORS
        """(4) Each motor's share of its commanded thrust; 0 of a dead one."""
        self.t_ns = t0_ns
        self.state: VehicleState = at_rest(start_lab_m, from_yaw(np.array(start_yaw_rad)))
        self.setpoint = LoopSetpoint(self.state.q_lab_from_flu, np.zeros(3), 0.0)
        self._air = air
        self._gusty = air.fan is not None
        self._sensors = Sensors(inertial, reader, t0_ns, self.state, has_receiver=has_receiver)
        self._attitudes: tuple[Quat, Quat] = (IDENTITY, IDENTITY)
        """True and as the autopilot has it, at the last sample; until the next both turn by the same gyroscope."""
        self._flown = LoopSetpoint(IDENTITY, np.zeros(3), 0.0)
        """What the autopilot's attitude estimate makes of the setpoint asked for."""
        self._turned_from: LoopSetpoint | None = self.setpoint
        """Of which `_flown` was made; None: of none with the attitudes of now."""
        self._delay_ns = round(profile.command_delay_s * 1e9)
        self._physics = physics
        self._t0_ns = t0_ns
        self._down_m_s2 = 0.0
        self._push = self._disturbance()
        self._coming: deque[tuple[int, LoopSetpoint]] = deque()

    @property
    def newest_sample(self) -> ImuSample | None:
        """Of its inertial sensors."""
        return self._sensors.newest

    def order(self, now_ns: int, setpoint: LoopSetpoint) -> None:
        """Let `setpoint` reach the attitude loop, after the delay of its own and after those ordered before it."""
        self._coming.append((now_ns + self._delay_ns, setpoint))

    def order_now(self, setpoint: LoopSetpoint) -> None:
        """Let `setpoint` rule from the grid's present on; what was on its way is forgotten."""
        self._coming.clear()
        self.setpoint = setpoint

    def stop(self) -> None:
        """It latches nothing: disarmed, its motors are off."""

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
            end_ns = min(end_ns, self._sensors.next_ns)
            steps = max((end_ns - self.t_ns) // step_ns, 1)
            self.state = self._integrated(step_ns * 1e-9, steps)
            self.t_ns += steps * step_ns
            if self.t_ns >= self._sensors.next_ns:
                q_estimated = self._sensors.sample(self.t_ns, self.state)
                self._attitudes = (self.state.q_lab_from_flu, q_estimated.copy())
                self._turned_from = None

    def state_at(self, now_ns: int) -> VehicleState:
        """The state at `now_ns`, at most one step past the grid's present, which does not move."""
        self.advance_to(now_ns)
        rest_ns = now_ns - self.t_ns
        return self._integrated(rest_ns * 1e-9, 1) if rest_ns > 0 else self.state

    @property
    def push_lab_m_s2(self) -> Vec3:
        """What the air does to the vehicle: acceleration in `lab`."""
        return self._push

    def receive_downwash(self, down_m_s2: float) -> None:
        """From the grid's present on the jets of others push it down so hard."""
        if down_m_s2 != self._down_m_s2:
            self._down_m_s2 = down_m_s2
            self._push = self._disturbance()

    def drain(self, dt_s: float) -> None:
        """Take `dt_s` at the present thrust out of the pack."""
        self.pack.drain(sum(self.state.motor_thrust_n.tolist()) / self.profile.weight_n, dt_s)

    def _integrated(self, dt_s: float, steps: int) -> VehicleState:
        scale, gain = self.pack.thrust_scale, self.motor_gain
        if self._turned_from is not self.setpoint:
            turn_target(*self._attitudes, self.setpoint.target, self._flown.target)
            self._turned_from = self.setpoint
        return self._physics.advance(
            self.state, self.profile, self._flown, self.armed, self._push, dt_s, steps, scale, gain
        )

    def _disturbance(self) -> Vec3:
        push = np.empty(3)
        push_into(self._air.air, (self.t_ns - self._t0_ns) * 1e-9, self.state.pos_lab_m, self.profile.reach_m, push)
        push[2] -= self._down_m_s2
        return push


def share_air(airframes: Sequence[Airframe]) -> None:
    """Let the jet of each of these vehicles push those below it, from the grids' present on."""
    down_m_s2 = np.empty(len(airframes))
    x, numbers = np.array([f.state.x for f in airframes]), np.array([f.profile.numbers for f in airframes])
    downwash_into(x, numbers, down_m_s2)
    for airframe, down in zip(airframes, down_m_s2.tolist(), strict=True):
        airframe.receive_downwash(down)

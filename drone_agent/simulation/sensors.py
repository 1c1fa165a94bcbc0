"""The sensors of one simulated vehicle, sampled on a raster of their own, and what they are connected to. No clock."""

from typing import Protocol

from drone_agent.flight.vehicle import ImuSample
from drone_agent.simulation.inertial import WINDOW_NS, InertialSensor
from formation.maths.arrays import Quat, Vec3
from formation.vehicle.profile import VehicleState

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

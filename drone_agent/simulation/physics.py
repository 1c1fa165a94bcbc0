"""What integrates a simulated vehicle: this project's own body and attitude loop, or somebody else's in its place."""

from dataclasses import dataclass
from typing import Protocol

from drone_agent.guard.position import LoopSetpoint
from drone_agent.simulation.attitude_loop import advance
from formation.maths.arrays import Float
from formation.vehicle.profile import VehicleProfile, VehicleState


class Advance(Protocol):
    """As drone_agent.simulation.attitude_loop.advance."""

    def __call__(
        self,
        state: VehicleState,
        profile: VehicleProfile,
        setpoint: LoopSetpoint,
        armed: bool,
        dist_lab_m_s2: Float,
        dt_s: float,
        steps: int,
        thrust_scale: float,
        motor_gain: Float,
    ) -> VehicleState:
        """The state `steps` steps of `dt_s` later; the input is left alone."""


@dataclass(frozen=True, slots=True)
class Physics:
    """A model, and the grid it is advanced on."""

    step_ns: int
    advance: Advance


OWN = Physics(1_000_000, advance)
"""Ours, at 1 kHz."""

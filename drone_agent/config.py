"""The configuration of a drone whose autopilot is ours: its guard's, that autopilot's, what a simulated one flies."""

from typing import Any, Literal

from pydantic import AliasChoices, Field, model_validator

from drone_agent.guard.config import GuardConfig, NonNegative
from drone_agent.simulation.disturbance import Disturbance
from drone_agent.simulation.inertial import InertialError
from formation.model import Vec3Tuple
from formation.vehicle.profile import VehicleProfile, profile


class AutopilotConfig(GuardConfig):
    """One drone whose autopilot runs in this process. Lengths in `lab`."""

    pose: Literal["own", "mocap"] = "own"
    """own: simulated positioning as an autopilot's SITL has; mocap: the external pose and nothing else."""
    start_lab_m: Vec3Tuple = (0.0, 0.0, 0.0)
    parameters: dict[str, float] = Field(default_factory=dict)
    rates_hz: dict[int, NonNegative] = Field(default_factory=dict)
    """Telemetry by MAVLink message id, where it shall differ from the autopilot's; 0 is off."""


class SimulatedDroneConfig(AutopilotConfig):
    """One simulated drone; `profile` may be changed key by key with `vehicle`."""

    autopilot: Literal["px4", "ardupilot"] = Field(
        default="px4", validation_alias=AliasChoices("autopilot", "personality")
    )
    """The autopilot it simulates; `personality` is the option's older name."""
    guard: bool = True
    """With `pose = mocap`: fly behind a guard in this process; false where a bridge of its own stands before it."""
    vehicle: dict[str, Any] = Field(default_factory=dict)
    """Overrides of the profile: what this particular drone really is."""
    start_yaw_rad: float = 0.0
    disturbance: Disturbance = Disturbance()
    inertial_error: InertialError = InertialError()
    """The errors of its inertial sensors: by them it knows its attitude, and where it is without a pose."""
    truth_rate_hz: NonNegative = 0.0
    """How often the true state is published; 0 leaves it to whoever asks."""

    @model_validator(mode="after")
    def _vehicle_exists(self) -> "SimulatedDroneConfig":
        self.true_vehicle()
        return self

    @property
    def is_guarded(self) -> bool:
        """Whether a guard in this process stands before the simulated autopilot."""
        return self.guard and self.pose == "mocap"

    def true_vehicle(self) -> VehicleProfile:
        """The profile with this drone's overrides; ValueError names what is unknown or out of range."""
        base = profile(self.profile, self.profiles)
        return VehicleProfile.model_validate({**base.model_dump(), **self.vehicle}) if self.vehicle else base

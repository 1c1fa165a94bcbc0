"""The configuration of one drone agent: who it is, how it is reached, what it flies and what it trusts."""

from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AliasChoices, Field, model_validator

from drone_agent.failsafe import LAND_AFTER_S
from drone_agent.simulation.disturbance import Disturbance
from drone_agent.simulation.inertial import InertialError
from formation.config import LinkConfig
from formation.identities import drone_identity
from formation.model import Model, Name, SysId, Vec3Tuple
from formation.vehicle.profile import VehicleProfile, profile
from wire.errors import ConfigError
from wire.security.bus_access import BusAccess
from wire.security.private_keys import mavlink_key_file
from wire.security.protection import Protection, protection_of

NonNegative = Annotated[float, Field(ge=0.0, allow_inf_nan=False)]
# Where PX4's and ArduPilot's simulators put their drones, so that a map shows something known.
ZURICH: Vec3Tuple = (47.397742, 8.545594, 488.0)


class AgentConfig(Model):
    """One simulated drone. Lengths in `lab`; `profile` may be changed key by key with `vehicle`."""

    sysid: SysId = 1
    lab: Name = "lab"
    body: Name | None = None
    """The mocap's name of this drone's body; `uav<sysid>` if not given."""
    link: LinkConfig = LinkConfig()
    autopilot: Literal["px4", "ardupilot"] = Field(
        default="px4", validation_alias=AliasChoices("autopilot", "personality")
    )
    """The autopilot it simulates; `personality` is the option's older name."""
    bridge: str | None = None
    """Be no drone but the bridge to a real autopilot: udp:HOST:PORT, udpin:HOST:PORT or serial:DEV:BAUD."""
    pose: Literal["own", "mocap"] = "own"
    """own: simulated positioning as an autopilot's SITL has; mocap: the external pose and nothing else."""
    guard: bool = True
    """With `pose = mocap`: fly behind a guard in this process; false where a bridge of its own stands before it."""
    inertial_rate_hz: Annotated[float, Field(ge=0.0, le=1000.0)] = 100.0
    """How often a bridge wants HIGHRES_IMU of its autopilot, to hold poses against it; 0: it does not."""
    profiles: tuple[VehicleProfile, ...] = ()
    profile: Name = "paper_40g"
    vehicle: dict[str, Any] = Field(default_factory=dict)
    """Overrides of the profile: what this particular drone really is."""
    start_lab_m: Vec3Tuple = (0.0, 0.0, 0.0)
    start_yaw_rad: float = 0.0
    disturbance: Disturbance = Disturbance()
    stale_setpoint_s: NonNegative = 0.1
    """A stream this silent is dead: level and hold. 0 leaves it to the autopilot's own time-outs."""
    stale_land_s: NonNegative | None = None
    """Then land this long after; not given: 1 s with `pose = mocap` or a bridge, else as the autopilot itself would."""
    inertial_error: InertialError = InertialError()
    """What its inertial sensors are wrong by: by them it knows its attitude, and where it is without a pose."""
    parameters: dict[str, float] = Field(default_factory=dict)
    parameter_file: Path | None = None
    """Where PARAM_SET keeps its values; not given: they die with the process."""
    keys: Path | None = None
    """Folder of the keys that `gcs keys install` wrote; without it every link must be on this machine."""
    insecure: bool = False
    """Simulation only: open links to other machines without keys."""
    origin: Vec3Tuple = ZURICH
    """Latitude and longitude, degrees, and altitude, m, of the lab's origin."""
    rates_hz: dict[int, NonNegative] = Field(default_factory=dict)
    """Telemetry by MAVLink message id, where it shall differ from the autopilot's; 0 is off."""
    truth_rate_hz: NonNegative = 0.0
    """How often the true state is published; 0 leaves it to whoever asks."""
    age_rate_hz: NonNegative = 50.0
    """How often, at most, the age of the newest setpoint is reported to the ground."""

    @model_validator(mode="after")
    def _vehicle_exists(self) -> "AgentConfig":
        self.true_vehicle()
        return self

    @property
    def is_networked(self) -> bool:
        """Whether its ground may be on another machine: then the bridge passes what its allow-list has, and no more."""
        return self.keys is not None or self.insecure

    @property
    def protection(self) -> Protection:
        """What protects this drone's links. ConfigError for keys that are missing or open to others."""
        if self.keys is not None:
            identity = drone_identity(self.sysid)
            found = protection_of(self.keys, identity)
            if found.channel(self.sysid) is None:
                key = self.keys / identity / mavlink_key_file(self.sysid)
                raise ConfigError([f"{key}: no signing key: `gcs keys rotate {identity}`, then pack and install it"])
            return found
        return Protection(BusAccess(insecure=self.insecure))

    @property
    def body_name(self) -> str:
        """The body this agent listens for in mocap frames."""
        return self.body if self.body is not None else f"uav{self.sysid}"

    @property
    def is_guarded(self) -> bool:
        """Whether a guard in this process stands before the simulated autopilot."""
        return self.guard and self.pose == "mocap" and self.bridge is None

    @property
    def land_after_s(self) -> float | None:
        """How long a hold on stale setpoints lasts before it lands; None: until the autopilot's own time-out."""
        if self.stale_land_s is None and (self.pose == "mocap" or self.bridge is not None):
            return LAND_AFTER_S
        return self.stale_land_s

    def true_vehicle(self) -> VehicleProfile:
        """The profile with this drone's overrides; ValueError names what is unknown or out of range."""
        base = profile(self.profile, self.profiles)
        return VehicleProfile.model_validate({**base.model_dump(), **self.vehicle}) if self.vehicle else base

"""The configuration of one guard: whose it is, how it is reached, what its vehicle is and what it trusts."""

from pathlib import Path
from typing import Annotated

from pydantic import Field

from drone_agent.guard.failsafe import LAND_AFTER_S
from formation.link_config import LinkConfig
from formation.model import Model, Name, SysId, Vec3Tuple
from formation.vehicle.profile import VehicleProfile

NonNegative = Annotated[float, Field(ge=0.0, allow_inf_nan=False)]
# Where PX4's and ArduPilot's simulators put their drones, so that a map shows something known.
ZURICH: Vec3Tuple = (47.397742, 8.545594, 488.0)


class GuardConfig(Model):
    """One drone's guard and its links. Lengths in `lab`."""

    sysid: SysId = 1
    lab: Name = "lab"
    body: Name | None = None
    """The mocap's name of this drone's body; `uav<sysid>` if not given."""
    link: LinkConfig = LinkConfig()
    inertial_rate_hz: Annotated[float, Field(ge=0.0, le=1000.0)] = 100.0
    """How often a bridge wants HIGHRES_IMU of its autopilot, to hold poses against it; 0: it does not."""
    profiles: tuple[VehicleProfile, ...] = ()
    profile: Name = "paper_40g"
    stale_setpoint_s: NonNegative = 0.1
    """A stream this silent is dead: level and hold. 0 leaves it to the autopilot's own time-outs."""
    stale_land_s: NonNegative = LAND_AFTER_S
    """Then land this long after."""
    keys: Path | None = None
    """Folder of the keys that `gcs keys install` wrote; without it every link must be on this machine."""
    insecure: bool = False
    """Simulation only: open links to other machines without keys."""
    origin: Vec3Tuple = ZURICH
    """Latitude and longitude, degrees, and altitude, m, of the lab's origin."""
    age_rate_hz: NonNegative = 50.0
    """How often, at most, the age of the newest setpoint is reported to the ground."""

    @property
    def is_networked(self) -> bool:
        """Whether its ground may be on another machine: then the guard passes what its allow-list has, and no more."""
        return self.keys is not None or self.insecure

    @property
    def body_name(self) -> str:
        """The body this drone listens for in mocap frames."""
        return self.body if self.body is not None else f"uav{self.sysid}"

"""A simulated flight as data: the lab, the true vehicles, the emulated mocap and links, the air, the operator.

`load` finds a scenario by path or, among those shipped, by name; `with_leader_file` puts in a recorded leader.
"""

from importlib import resources
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import Field, model_validator

from formation import frames
from formation.arrays import Quat, Vec3
from formation.config import LabConfig, Model, Positive, QuatTuple, SysId, Vec3Tuple
from formation.vehicle import VehicleProfile, profile
from sim.mocap import EmulatorConfig, NotNegative
from sim.script import FLIGHT, Step
from wire import config_file


class LinkDelay(Model):
    """One-way delay of the in-memory links: a constant part and the standard deviation of what varies."""

    down_s: NotNegative = 0.004
    up_s: NotNegative = 0.004
    jitter_s: NotNegative = 0.0005


class Pose(Model):
    """Where a vehicle, or a leader no drone carries, stands at the start; lab axes."""

    pos_lab_m: Vec3Tuple
    yaw_rad: float = 0.0


class TrueVehicle(Model):
    """What one simulated drone really is; `vehicle` overrides the profile its lab entry names.

    Without `start`, a follower stands on the floor below its slot, a commanded leader at the lab's origin.
    """

    sysid: SysId
    start: Pose | None = None
    vehicle: dict[str, float | bool | Vec3Tuple] = Field(default_factory=dict)
    personality: str = "px4"


class ObservedLeader(Model):
    """A leader no drone carries: a body standing at `pose`, or moving as recorded in `file` (CSV, ASL format)."""

    pose: Pose = Pose(pos_lab_m=(0.0, 0.0, 1.0))
    file: str | None = None


class Scenario(Model):
    """Everything a simulated flight is; the seed and this determine it.

    formation_s: how long the formation is held where the leader's own trajectory does not say.
    """

    name: str
    about: str = ""
    seed: Annotated[int, Field(ge=0)] = 1
    longest_s: Positive = 240.0
    formation_s: Positive | None = None
    lab: LabConfig
    mocap: EmulatorConfig = EmulatorConfig()
    link_delay: LinkDelay = LinkDelay()
    vehicles: tuple[TrueVehicle, ...] = ()
    leader: ObservedLeader = ObservedLeader()
    needs_leader_file: bool = False
    script: tuple[Step, ...] = FLIGHT

    @model_validator(mode="after")
    def _known_vehicles(self) -> "Scenario":
        commanded = {v.sysid for v in self.lab.vehicles}
        for vehicle in self.vehicles:
            if vehicle.sysid not in commanded:
                raise ValueError(f"sysid {vehicle.sysid} is not in the lab")
            self.true_profile(vehicle.sysid)
        return self

    def true_vehicle(self, sysid: int) -> TrueVehicle:
        """The simulated drone of that sysid; one that is exactly as the lab says where nothing else is said."""
        return next((v for v in self.vehicles if v.sysid == sysid), TrueVehicle(sysid=sysid))

    def true_profile(self, sysid: int) -> VehicleProfile:
        """What the drone of that sysid really is."""
        named = next(v.profile for v in self.lab.vehicles if v.sysid == sysid)
        return VehicleProfile.model_validate(profile(named).model_dump() | self.true_vehicle(sysid).vehicle)


def shipped() -> dict[str, Path]:
    """The scenarios that come with the simulator, by name."""
    folder = Path(str(resources.files("sim"))) / "scenarios"
    return {path.stem: path for path in sorted(folder.glob("*.toml"))}


def load(name_or_path: str) -> Scenario:
    """The scenario of a file, or a shipped one of that name; wire.config_file.ConfigError where it is not right."""
    path = shipped().get(name_or_path, Path(name_or_path))
    if not path.exists():
        known = ", ".join(shipped())
        raise config_file.ConfigError(f"{name_or_path}: no such file, nor a shipped scenario ({known})")
    scenario = config_file.load(path, Scenario)
    recorded = scenario.leader.file
    if recorded is None or Path(recorded).is_absolute():
        return scenario
    return with_leader_file(scenario, str(path.parent / recorded))


def with_leader_file(scenario: Scenario, file: str | None, q_marker_from_flu: QuatTuple | None = None) -> Scenario:
    """The scenario with its observed leader recorded in `file`, and that body's alignment; ValueError if commanded."""
    if file is None and q_marker_from_flu is None:
        return scenario
    leader = scenario.lab.leader
    if leader.sysid is not None:
        raise ValueError(f"the leader of {scenario.name} is a drone (sysid {leader.sysid}), not a recorded body")
    if q_marker_from_flu is not None:
        leader = leader.model_copy(update={"q_marker_from_flu": q_marker_from_flu})
    update: dict[str, object] = {"lab": scenario.lab.model_copy(update={"leader": leader})}
    if file is not None:
        update["leader"] = scenario.leader.model_copy(update={"file": file})
    return scenario.model_copy(update=update)


def starts(scenario: Scenario, leader_pos_lab_m: Vec3, leader_q_lab_from_flu: Quat) -> dict[int, Pose]:
    """Where every simulated drone stands at the start, by sysid; the leader's pose is where it is then."""
    yaw = float(frames.yaw(leader_q_lab_from_flu))
    placed = {}
    for i, vehicle in enumerate(scenario.lab.vehicles):
        if vehicle.sysid is None:
            continue
        wanted = scenario.true_vehicle(vehicle.sysid).start
        follower = scenario.lab.followers[i - 1] if i else None
        if wanted is None and follower is not None:
            x, y, _ = leader_pos_lab_m + frames.rotate_about_z(np.array(yaw), np.array(follower.offset_m))
            wanted = Pose(pos_lab_m=(float(x), float(y), 0.0), yaw_rad=yaw + follower.yaw_offset_rad)
        placed[vehicle.sysid] = wanted or Pose(pos_lab_m=(0.0, 0.0, 0.0))
    return placed

"""A simulated flight as data: the lab, the true vehicles, the emulated mocap and links, the air, the operator.

`find` takes a scenario's or a lab's file or, among those shipped, a name; `with_leader_file` puts in a recorded leader.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import AliasChoices, Field, model_validator

from drone_agent.config import SimulatedDroneConfig
from drone_agent.simulation.disturbance import Disturbance
from drone_agent.simulation.inertial import InertialError
from formation.config import LabConfig
from formation.maths import frames
from formation.maths.arrays import Vec3
from formation.model import Model, Name, Positive, QuatTuple, SysId, Vec3Tuple, WrongKeyError
from formation.names import unknown
from formation.vehicle.profile import VehicleProfile
from mocap.sources.csv_file import read_recording
from sim.cameras.emulator import EmulatorConfig, NotNegative, Share
from sim.cameras.playback import Playback
from sim.faults.fault import GROUND_RECEIVER, Fault, Site
from sim.lab_file import scenario_values
from sim.script import FLIGHT, Step
from sim.shipped import shipped
from wire import config_file
from wire.files import read_toml

ONLY_IN_SCENARIOS = frozenset({"about", "air", "faults", "formation_s", "longest_s", "script", "seed", "vehicles"})
"""Keys that no lab file has: a file with one of them, and no lab, is a scenario that lacks its lab."""


class LinkModel(Model):
    """The in-memory links to and from the drones: delay, the mean of what comes on top, the share lost.

    ingest_s: the ground's work for one packet of a drone, which bounds what it takes in (wire.transport.link): on a
    desktop some 60 a millisecond.
    """

    down_s: NotNegative = 0.004
    up_s: NotNegative = 0.004
    jitter_s: NotNegative = 0.0005
    lost_share: Share = 0.0
    ingest_s: NotNegative = 17e-6


class Pose(Model):
    """Where a vehicle, or a leader no drone carries, stands at the start; lab axes."""

    pos_lab_m: Vec3Tuple
    yaw_rad: float = 0.0


class TrueVehicle(Model):
    """One simulated drone as it really is; `vehicle` overrides the profile its lab entry names.

    Without `start`, a follower stands on the floor below its slot, a commanded leader at the lab's origin.
    """

    sysid: SysId
    start: Pose | None = None
    vehicle: dict[str, float | bool | Vec3Tuple] = Field(default_factory=dict)
    autopilot: Literal["px4", "ardupilot"] = Field(
        default="px4", validation_alias=AliasChoices("autopilot", "personality")
    )
    bridged: bool = False
    """With real processes: its guard is a process of its own, the bridge, as before a real autopilot."""
    inertial_error: InertialError = InertialError()
    inertial_rate_hz: Annotated[float, Field(ge=0.0, le=1000.0)] = 100.0
    """Rate at which the guard asks for HIGHRES_IMU; 0: as of an autopilot that sends none."""


class ObservedLeader(Model):
    """A leader no drone carries: a body standing at `pose`, or moving as recorded in `file` (CSV)."""

    pose: Pose = Pose(pos_lab_m=(0.0, 0.0, 1.0))
    file: str | None = None


class Scenario(Model):
    """Everything a simulated flight is; the seed and this determine it.

    formation_s: how long the formation is held where the leader's own trajectory does not say. faults: what goes wrong,
    in lockstep.
    """

    name: Name
    about: str = ""
    seed: Annotated[int, Field(ge=0)] = 1
    longest_s: Positive = 240.0
    formation_s: Positive | None = None
    lab: LabConfig
    mocap: EmulatorConfig = EmulatorConfig()
    link: LinkModel = LinkModel()
    air: Disturbance = Disturbance()
    vehicles: tuple[TrueVehicle, ...] = ()
    leader: ObservedLeader = ObservedLeader()
    needs_leader_file: bool = False
    script: tuple[Step, ...] = FLIGHT
    faults: tuple[Fault, ...] = ()

    @model_validator(mode="after")
    def _known_vehicles(self) -> "Scenario":
        commanded = {v.sysid for v in self.lab.vehicles}
        for k, vehicle in enumerate(self.vehicles):
            if vehicle.sysid not in commanded:
                raise WrongKeyError(f"vehicles[{k}].sysid", f"sysid {vehicle.sysid} is not in the lab")
        return self

    @model_validator(mode="after")
    def _known_victims(self) -> "Scenario":
        bodies = {v.body for v in self.lab.vehicles}
        for k, fault in enumerate(self.faults):
            for body in {fault.body, fault.other, fault.receiver} - {None}:
                if body not in bodies and not (body == GROUND_RECEIVER and fault.site is Site.BUS):
                    text = f"{body}, which the fault `{fault.family}` is about, is not in the lab"
                    raise WrongKeyError(f"faults[{k}]", f"{text}: {', '.join(sorted(bodies))}")
        return self

    def true_vehicle(self, sysid: int) -> TrueVehicle:
        """The simulated drone of that sysid; one that is exactly as the lab says where nothing else is said."""
        return next((v for v in self.vehicles if v.sysid == sysid), TrueVehicle(sysid=sysid))


@dataclass(frozen=True, slots=True)
class ScenarioFile:
    """A scenario as it was found.

    lab_file, lab: where it flies a lab file: that file, and all that stands in it, real links and cameras included.
    """

    scenario: Scenario
    lab_file: Path | None = None
    lab: LabConfig | None = None


def load(name_or_path: str) -> Scenario:
    """The scenario of a file, or a shipped one of that name; wire.config_file.ConfigError where it is not right."""
    return find(name_or_path).scenario


def find(name_or_path: str) -> ScenarioFile:
    """The shipped scenario of that name, or a file: a scenario with its lab, one that names a lab file, or a lab file.

    wire.config_file.ConfigError where it is not right.
    """
    path = shipped().get(name_or_path, Path(name_or_path))
    if not path.exists():
        reason = f"no such file, nor a shipped scenario {unknown(name_or_path, shipped())}"
        raise config_file.ConfigError([f"{name_or_path}: {reason}"])
    values = read_toml(path)
    named = values.get("lab")
    if isinstance(named, str):
        return _of_lab_file(path, path.parent / named, values)
    if named is None and not ONLY_IN_SCENARIOS & set(values):
        return _of_lab_file(path, path, {})
    return ScenarioFile(_beside(path, config_file.parse(values, Scenario, source=str(path), folder=path.parent)))


def _of_lab_file(path: Path, lab_file: Path, values: dict[str, Any]) -> ScenarioFile:
    lab = config_file.load(lab_file, LabConfig)
    named = {"name": lab.name} | values
    scenario = config_file.parse(scenario_values(lab, named), Scenario, source=str(path), folder=path.parent)
    return ScenarioFile(_beside(path, scenario), lab_file, lab)


def _beside(path: Path, scenario: Scenario) -> Scenario:
    """The scenario with the leader's recording, where it has one, looked for beside its file."""
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


def flown_by(lab: LabConfig, vehicle: VehicleProfile, preset: str) -> LabConfig:
    """The lab with every drone believed to be `vehicle`, under a control preset."""
    leader = lab.leader.model_copy(update={"profile": vehicle.name})
    followers = tuple(follower.model_copy(update={"profile": vehicle.name}) for follower in lab.followers)
    return lab.model_copy(
        update={"profiles": (vehicle,), "leader": leader, "followers": followers, "control_preset": preset}
    )


def recorded_leader(scenario: Scenario) -> Playback | None:
    """The leader that no drone carries, ready to be played; MocapFileError where its file is not right."""
    if scenario.lab.leader.sysid is not None:
        return None
    if scenario.leader.file is not None:
        return Playback(read_recording(Path(scenario.leader.file), scenario.lab.leader.body))
    mocap = scenario.lab.mocap
    q_mocap_from_lab = frames.inverse(np.array(mocap.q_lab_from_mocap))
    pos_lab_m = np.array(scenario.leader.pose.pos_lab_m)
    q_lab_from_flu = frames.from_yaw(np.array(scenario.leader.pose.yaw_rad))
    q_lab_from_marker = frames.multiply(q_lab_from_flu, frames.inverse(np.array(scenario.lab.leader.q_marker_from_flu)))
    return Playback.standing(
        frames.rotate(q_mocap_from_lab, pos_lab_m - np.array(mocap.origin_lab_m)),
        frames.multiply(q_mocap_from_lab, q_lab_from_marker),
    )


def leader_seconds(scenario: Scenario, leader: Playback | None) -> float | None:
    """How long the leader is on its way and in the air; None where its own trajectory says."""
    if scenario.formation_s is not None or leader is None:
        return scenario.formation_s
    return leader.flight_ns * 1e-9


def agent_configs(scenario: Scenario, leader: Playback | None) -> tuple[SimulatedDroneConfig, ...]:
    """The simulated drones, in the lab's order, each on its starting place."""
    pos_lab_m, yaw_rad = _leader_start(scenario, leader)
    configs = []
    for i, vehicle in enumerate(scenario.lab.vehicles):
        if vehicle.sysid is None:
            continue
        true = scenario.true_vehicle(vehicle.sysid)
        start = true.start or Pose(pos_lab_m=(float(pos_lab_m[0]), float(pos_lab_m[1]), 0.0), yaw_rad=yaw_rad)
        if true.start is None and i > 0:
            follower = scenario.lab.followers[i - 1]
            x, y, _ = pos_lab_m + frames.rotate_about_z(np.array(yaw_rad), np.array(follower.offset_m))
            start = Pose(pos_lab_m=(float(x), float(y), 0.0), yaw_rad=yaw_rad + follower.yaw_offset_rad)
        configs.append(
            SimulatedDroneConfig(
                sysid=vehicle.sysid,
                lab=scenario.lab.name,
                body=vehicle.body,
                link=scenario.lab.link,
                autopilot=true.autopilot,
                pose="mocap",
                profiles=scenario.lab.profiles,
                profile=vehicle.profile,
                vehicle=dict(true.vehicle),
                start_lab_m=start.pos_lab_m,
                start_yaw_rad=start.yaw_rad,
                disturbance=scenario.air,
                inertial_error=true.inertial_error,
                inertial_rate_hz=true.inertial_rate_hz,
            )
        )
    return tuple(configs)


def _leader_start(scenario: Scenario, leader: Playback | None) -> tuple[Vec3, float]:
    """Position and heading, lab, of the leader before anything moves."""
    config = scenario.lab.leader
    if leader is None:
        start = (scenario.true_vehicle(config.sysid).start if config.sysid else None) or Pose(pos_lab_m=(0.0, 0.0, 0.0))
        return np.array(start.pos_lab_m), start.yaw_rad
    pos_mocap_m, q_mocap_from_marker = leader.pose(0)
    q_lab_from_mocap = np.array(scenario.lab.mocap.q_lab_from_mocap)
    pos_lab_m = frames.rotate(q_lab_from_mocap, pos_mocap_m) + np.array(scenario.lab.mocap.origin_lab_m)
    q_lab_from_marker = frames.multiply(q_lab_from_mocap, q_mocap_from_marker)
    return pos_lab_m, float(frames.yaw(frames.multiply(q_lab_from_marker, np.array(config.q_marker_from_flu))))

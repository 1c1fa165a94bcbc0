"""The configuration of a lab and of a simulated drone: one frozen pydantic model each, unknown keys refused.

Reading files is `wire.config_file`'s work; simulation scenarios extend this in `sim.scenario`.
"""

from collections.abc import Mapping
from typing import Annotated, Any, Literal, Protocol, Self

from pydantic import AfterValidator, Field, ValidationError, ValidationInfo, model_validator

from formation.link_config import LinkConfig as LinkConfig
from formation.mocap_config import MocapConfig as MocapConfig
from formation.model import (
    NO_ROTATION,
    GlobePoint,
    Model,
    Name,
    NoFlag,
    Number,
    OwnLink,
    Positive,
    SysId,
    Tilt,
    UnitQuat,
    Vec3Tuple,
    WrongKeyError,
)
from formation.names import unknown
from formation.requests import CONFIGURED as CONFIGURED
from formation.requests import LAB
from formation.security_config import SecurityConfig
from formation.trajectory_config import TrajectoryConfig as TrajectoryConfig
from formation.vehicle.profile import VehicleProfile, on_base, profile

Share = Annotated[float, NoFlag, Field(ge=0.0, lt=1.0)]
PRESET_NAMES = ("default", "pid_leader", "paper", "paper_istsmc", "paper_smc", "pid", "geometric", "no_downwash")
"""The sets of gains of formation.control.presets, known here so that a lab is judged before the control is loaded."""


def _preset(name: str) -> str:
    if name not in PRESET_NAMES:
        raise ValueError(f"unknown control preset {unknown(name, PRESET_NAMES)}")
    return name


UNGUARDED = (
    "a drone with a link of its own has no guard: only its autopilot acts when the ground dies or a pose is wrong; "
    'write guard = "none" to fly so, or put it behind drone-agent --bridge and delete its link'
)


class VehicleBody(Model):
    """One rigid body the mocap sees: its name, its drone (if commanded) and its marker frame's alignment.

    link: the drone's own link where it has one, `udp:HOST:PORT` or `udpin:HOST:PORT`. guard: "none" with such a link: a
    real autopilot that nothing guards has to be said to be one. spawn_lab_m: where in the
    lab the drone is expected to start: simulators begin there.
    """

    body: Name
    """Name of the rigid body in the lab file, the logs and on the page."""
    sysid: SysId | None = None
    """MAVLink system id of its drone; without one the body is only observed."""
    profile: Name = "paper_40g"
    """Vehicle model of its drone: a shipped profile or one of `[[profiles]]`."""
    q_marker_from_flu: UnitQuat = NO_ROTATION
    """Orientation of the body's axes in its marker frame, `w, x, y, z`."""
    link: OwnLink | None = None
    guard: Literal["none"] | None = None
    spawn_lab_m: Vec3Tuple = (0.0, 0.0, 0.0)

    @property
    def names_profile(self) -> bool:
        """Whether the lab file says which vehicle it is."""
        return "profile" in self.model_fields_set

    @model_validator(mode="after")
    def _unguarded_on_purpose(self) -> Self:
        if self.link is not None and self.guard is None:
            raise WrongKeyError("guard", UNGUARDED)
        return self


class LeaderConfig(VehicleBody):
    """The body the formation is held on; without a sysid it is observed only, never commanded."""

    trajectory: TrajectoryConfig = TrajectoryConfig()
    """What a commanded leader flies in `FORMATION`."""
    trajectories: dict[Name, TrajectoryConfig] = Field(default_factory=dict)
    """Further ones, by name, among which the operator chooses; `configured` is the one above."""
    spawn_yaw_rad: Number = 0.0
    """Heading in which a commanded leader is expected to start, about lab z; the slots turn with it."""

    @model_validator(mode="after")
    def _leaves_the_configured_one(self) -> Self:
        if CONFIGURED in self.trajectories:
            raise WrongKeyError(f"trajectories.{CONFIGURED}", "this name is that of `trajectory`: choose another")
        return self


class FollowerConfig(VehicleBody):
    """A follower and its slot in the leader's frame."""

    sysid: SysId
    """MAVLink system id of its drone."""
    offset_m: Vec3Tuple
    """Slot in the leader's frame: forward, left, up."""
    yaw_offset_rad: Number = 0.0
    """Heading relative to the leader's."""


class SlotConfig(Model):
    """One follower's place in a listed shape: offset and heading in the leader's frame."""

    offset_m: Vec3Tuple
    """Slot in the leader's frame: forward, left, up."""
    yaw_offset_rad: Number = 0.0
    """Heading relative to the leader's."""


class FormationConfig(Model):
    """Shapes that the followers may change to: the distance of neighbours in the named ones, and further ones, listed.

    shapes: by name, one slot a follower; a list under the name of a pattern replaces it. own_shapes: names of shapes
    that the lab's own packages make.
    """

    spacing_m: Positive = 0.5
    """Distance of neighbours in the named shapes."""
    shapes: dict[Name, tuple[SlotConfig, ...]] = Field(default_factory=dict)
    own_shapes: tuple[Name, ...] = ()

    @model_validator(mode="after")
    def _leaves_the_configured_one(self) -> Self:
        if CONFIGURED in self.shapes:
            raise WrongKeyError(f"shapes.{CONFIGURED}", "this name is that of the followers' own slots: choose another")
        return self


class ShapeReader(Protocol):
    """Who knows the shapes that the lab's own packages make."""

    def shape_of(self, name: str, n: int, spacing_m: float) -> list[list[float]]:
        """The slots of n followers; ValueError where no package makes it, or it is none."""


class Fence(Model):
    """The box, in lab axes, that no commanded drone may leave."""

    low_m: Vec3Tuple = (-2.5, -2.0, -0.1)
    """Lowest x, y, z in `lab`."""
    high_m: Vec3Tuple = (2.5, 2.0, 2.3)
    """Highest x, y, z in `lab`."""

    @model_validator(mode="after")
    def _is_a_box(self) -> Self:
        for axis, low, high in zip("xyz", self.low_m, self.high_m, strict=True):
            if low >= high:
                raise WrongKeyError(
                    "low_m", f"low_m is {low:g} and high_m {high:g} along {axis}: low must be under high"
                )
        return self


FENCE_INSET_M = 0.1
"""So far inside the fence is the nearest place that a drone is led to."""
PERSONAL_SPACE = 1.5
"""Slots and the ways into them are this many minimum separations apart: nearer, the separation filter would brake."""


class LimitsConfig(Model):
    """What no command may exceed."""

    tilt_rad: Tilt = 0.6
    """Largest tilt that an attitude target asks for. Body rates beside it may tilt a drone further in a push."""
    speed_m_s: Positive = 3.0
    """Largest speed that is commanded."""
    min_separation_m: Positive = 0.2
    """Smallest distance between any two bodies."""
    fence: Fence = Fence()
    """Flight volume of the commanded drones."""
    battery_low_share: Share = 0.2
    """Charge under which a drone is warned of, and does not arm."""
    battery_empty_share: Share = 0.1
    """Charge under which all land."""

    @model_validator(mode="after")
    def _empty_is_less_than_low(self) -> Self:
        if self.battery_empty_share > self.battery_low_share:
            text = f"battery_low_share is {self.battery_low_share:g}: empty is not more than low"
            raise WrongKeyError("battery_empty_share", text, self.battery_empty_share)
        return self


class FlightConfig(Model):
    """Heights and speeds of take-off and landing, and the speed at which slots are taken up and changed."""

    altitude_m: Positive = 0.3
    """Height of take-off, hold and formation."""
    climb_m_s: Positive = 0.4
    """Speed of the take-off."""
    descend_m_s: Positive = 0.3
    """Speed of the landing."""
    formation_change_m_s: Positive = 0.5
    """Largest speed at which slots are taken up and changed."""
    observed_leader_altitude_offset_m: Number = 0.0
    """Height of the formation above a leader that is only observed."""


class StopButton(Model):
    """A key or button that stops the swarm: the Linux input device it is on and, of its buttons, which.

    device: `/dev/input/by-id/...` of a keyboard, keypad or joystick, or a joystick's `/dev/input/js0`.
    button: its code (`gcs buttons` prints it); not given, any button of the device.
    """

    device: Annotated[str, Field(min_length=1, max_length=255)]
    button: Annotated[int, NoFlag, Field(ge=0, le=767)] | None = None


class OperatorConfig(Model):
    """What the person beside the drones has in hand."""

    stop_button: StopButton | None = None


class LawReader(Protocol):
    """Who knows the control laws of the lab's own packages."""

    def check_law(self, name: str, options: Mapping[str, Any]) -> None:
        """ValueError where no package registers the law, or it cannot be made with these options."""


class ControlLawConfig(Model):
    """The lab's own law for the followers in formation: its name in a package of the lab's, and what it is given."""

    name: Name
    """Entry point of the law in group `mavlink_formation.control_laws`."""
    options: dict[str, float | int | str | bool] = Field(default_factory=dict)
    """Arguments of the law."""

    @model_validator(mode="after")
    def _is_here(self, info: ValidationInfo) -> Self:
        packages: LawReader | None = info.context
        if packages is not None:
            try:
                packages.check_law(self.name, self.options)
            except ValueError as error:
                raise WrongKeyError("name", str(error), self.name) from error
        return self


class LabConfig(Model):
    """lab.toml: everything `gcs run` needs.

    origin: latitude and longitude, degrees, and altitude, m, of the lab's origin, for autopilots that will not use an
    external pose before they know where on the globe they are.
    """

    name: Name = LAB
    """Name of the lab: the root of its keys on the bus."""
    origin: GlobePoint = (47.397742, 8.545594, 488.0)
    mocap: MocapConfig = MocapConfig()
    profiles: tuple[VehicleProfile, ...] = ()
    """The lab's own vehicles, as `gcs-log identify --write` writes them; they come before the shipped ones."""
    leader: LeaderConfig
    followers: Annotated[tuple[FollowerConfig, ...], Field(min_length=1)]
    formation: FormationConfig = FormationConfig()
    control_preset: Annotated[str, AfterValidator(_preset)] = "default"
    """Gains of the built-in laws; see the page on profiles and presets."""
    control_law: ControlLawConfig | None = None
    limits: LimitsConfig = LimitsConfig()
    flight: FlightConfig = FlightConfig()
    link: LinkConfig = LinkConfig()
    operator: OperatorConfig = OperatorConfig()
    security: SecurityConfig | None = None
    """Keys and roles; without it every endpoint must be on this machine."""

    @model_validator(mode="before")
    @classmethod
    def _profiles_from_shipped(cls, values: Any) -> Any:
        """Profiles that begin from a shipped one: `base`, and what is different."""
        own = values.get("profiles") if isinstance(values, dict) else None
        if not isinstance(own, list | tuple):
            return values
        whole = []
        for k, entry in enumerate(own):
            try:
                whole.append(on_base(entry) if isinstance(entry, dict) else entry)
            except ValueError as error:
                raise WrongKeyError(f"profiles[{k}].base", str(error)) from error
        return values | {"profiles": whole}

    @model_validator(mode="before")
    @classmethod
    def _shapes_of_packages(cls, values: Any, info: ValidationInfo) -> Any:
        """The shapes of the lab's own packages that it names, where the file lists none of that name."""
        makers: ShapeReader | None = info.context
        if makers is None or not isinstance(values, dict) or not isinstance(values.get("followers"), list):
            return values
        try:
            own = FormationConfig.model_validate(values.get("formation", {}))
        except ValidationError:  # reported with its keys when the tables are read
            return values
        n, table = len(values["followers"]), values.get("formation", {})
        made = {
            name: [{"offset_m": slot} for slot in makers.shape_of(name, n, own.spacing_m)]
            for name in own.own_shapes
            if name not in own.shapes
        }
        return values | {"formation": table | {"shapes": table.get("shapes", {}) | made}} if made else values

    @model_validator(mode="after")
    def _unique(self) -> Self:
        of_body: dict[str, str] = {}
        of_sysid: dict[int, str] = {}
        for i, vehicle in enumerate(self.vehicles):
            key = self.key_of(i)
            if vehicle.body in of_body:
                raise WrongKeyError(
                    f"{key}.body", f"{of_body[vehicle.body]} has it, too: two vehicles share a body name", vehicle.body
                )
            if vehicle.sysid in of_sysid:
                raise WrongKeyError(
                    f"{key}.sysid", f"{of_sysid[vehicle.sysid]} has it, too: two vehicles share a sysid", vehicle.sysid
                )
            of_body[vehicle.body] = key
            if vehicle.sysid is not None:
                of_sysid[vehicle.sysid] = key
        for name, slots in self.formation.shapes.items():
            if len(slots) != len(self.followers):
                text = f"{len(slots)} slots for {len(self.followers)} followers: one a follower is needed"
                raise WrongKeyError(f"formation.shapes.{name}", text)
        return self

    @staticmethod
    def key_of(i: int) -> str:
        """The key of a vehicle in the file, by its index."""
        return "leader" if i == 0 else f"followers[{i - 1}]"

    @model_validator(mode="after")
    def _known_profiles(self) -> Self:
        for i, vehicle in enumerate(self.vehicles):
            try:
                self.profile_of(vehicle)
            except ValueError as error:
                raise WrongKeyError(f"{self.key_of(i)}.profile", str(error)) from error
        return self

    def flying(self, trajectory: str) -> "LabConfig":
        """The same lab with that one of its leader's trajectories; ValueError names those there are."""
        if trajectory == CONFIGURED:
            return self
        if trajectory not in self.leader.trajectories:
            raise ValueError(f"no trajectory {unknown(trajectory, (CONFIGURED, *self.leader.trajectories))}")
        leader = self.leader.model_copy(update={"trajectory": self.leader.trajectories[trajectory]})
        return self.model_copy(update={"leader": leader})

    def profile_of(self, vehicle: VehicleBody) -> VehicleProfile:
        """The model of one of the lab's vehicles; ValueError names the known ones."""
        return profile(vehicle.profile, self.profiles)

    @property
    def vehicles(self) -> tuple[VehicleBody, ...]:
        """All n vehicles, leader first: the order of every n-indexed array."""
        return (self.leader, *self.followers)

    @property
    def half_widths_m(self) -> list[float]:
        """How far each of the n bodies reaches from its middle, whatever its heading."""
        return [0.5 * self.profile_of(vehicle).width_m for vehicle in self.vehicles]

    @property
    def link_kinds(self) -> str:
        """How its drones are reached, each way once: the shared link's kind, `udp` for a drone's own."""
        drones = [v for v in self.vehicles if v.sysid is not None]
        kinds = {self.link.kind if v.link is None else "udp" for v in drones}
        return " and ".join(sorted(kinds))

    @property
    def commanded(self) -> tuple[int, ...]:
        """Indices into `vehicles` of the m commanded ones: the order of every m-indexed array."""
        return tuple(i for i, v in enumerate(self.vehicles) if v.sysid is not None)

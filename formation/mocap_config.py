"""Where poses come from, as the lab file says it: the camera system, how it is reached, its axes, unit and latency."""

from ipaddress import ip_address
from math import copysign, sqrt
from typing import Annotated, Any, Literal, Self

from pydantic import BeforeValidator, Field, model_validator

from formation.model import (
    NO_ROTATION,
    Flag,
    Host,
    Model,
    Name,
    NoFlag,
    Positive,
    QuatTuple,
    UnitQuat,
    Vec3Tuple,
    WrongKeyError,
)

Port = Annotated[int, NoFlag, Field(ge=1, le=65_535)]
Seconds = Annotated[float, NoFlag, Field(ge=0.0, le=0.5)]
SourceText = Annotated[str, Field(min_length=1, max_length=128)]
"""A body's name as the camera system writes it, blanks and all."""
UNITS_M = {"m": 1.0, "cm": 0.01, "mm": 0.001}
CAMERA_SYSTEMS = ("vrpn", "chingmu", "nokov", "natnet", "qualisys", "vicon", "ros2")
BODY_BY_BODY = ("vrpn", "chingmu", "nokov", "ros2")
"""What these send is a message a body, of which frames are assembled."""
FIRST_SENSOR = 300
"""Number of Chingmu's first rigid body; below are its markers."""
MILLIMETRES = ("chingmu", "qualisys", "vicon")
"""What these send, whatever else is set."""
IN_METRES = ("zenoh", "ros2")
"""What is defined in metres, by messages of ours or of ROS."""
BODY = "{body}"
"""What stands for a body's name in a topic."""
Topic = Annotated[str, Field(pattern=r"^(/([A-Za-z0-9_]|\{body\})+)+$", max_length=128)]
_POINTING = {
    "forward": (1, 0, 0),
    "back": (-1, 0, 0),
    "left": (0, 1, 0),
    "right": (0, -1, 0),
    "up": (0, 0, 1),
    "down": (0, 0, -1),
}
_Row = tuple[float, float, float]
_OLD_KEYS = {
    "assemble_s": "write mocap.assemble_s",
    "repeats_are_lost": "write mocap.repeats_are_lost",
    "first_sensor": "write the sensors' numbers into mocap.names",
}


class VrpnConfig(Model):
    """A VRPN server: one tracker a body. udp: poses as datagrams."""

    host: Host = "127.0.0.1"
    """Computer of the server."""
    port: Port = 3883
    """TCP port of the server."""
    udp: Flag = False


class NokovConfig(VrpnConfig):
    """NOKOV's XINGYING: VRPN with a tracker a body. The network protocol of its SDK is not published."""


class ChingmuConfig(Model):
    """A Chingmu server (CMTracker or CMAvatar): VRPN with one tracker, each body one of its sensors."""

    host: Host = "127.0.0.1"
    """Computer of the server."""
    port: Port = 3883
    """TCP port of the server."""
    device: Name = "MCServer"
    """Name of the VRPN device."""


class NatNetConfig(Model):
    """OptiTrack's Motive. multicast: the group it streams to, empty for unicast; interface: our own address."""

    host: Host = "127.0.0.1"
    """Computer that Motive runs on."""
    multicast: Annotated[Host | Literal[""], BeforeValidator(lambda group: group or "")] = "239.255.42.99"
    interface: Host = "0.0.0.0"
    command_port: Port = 1510
    """UDP port of commands."""
    data_port: Port = 1511
    """UDP port of frames."""

    @model_validator(mode="after")
    def _group_is_one(self) -> Self:
        try:
            is_group = not self.multicast or ip_address(self.multicast).is_multicast
        except ValueError:
            is_group = False
        if not is_group:
            text = 'no multicast group: those are 224.0.0.0 to 239.255.255.255, "" is unicast'
            raise WrongKeyError("multicast", text, self.multicast)
        return self


class QualisysConfig(Model):
    """Qualisys Track Manager's real-time server."""

    host: Host = "127.0.0.1"
    """Computer that QTM runs on."""
    port: Port = 22223
    """TCP port of the real-time server."""


class ViconConfig(Model):
    """A Vicon DataStream server: Tracker, Nexus, Shogun."""

    host: Host = "127.0.0.1"
    """Computer that Tracker, Nexus or Shogun runs on."""
    port: Port = 801
    """TCP port of the DataStream."""


PosesType = Literal[
    "geometry_msgs/msg/PoseStamped",
    "nav_msgs/msg/Odometry",
    "motion_capture_tracking_interfaces/msg/NamedPoseArray",
    "motion_capture_tracking_interfaces/msg/NamedPoseArrayV2",
]


class Ros2Config(Model):
    """A ROS 2 graph that has the poses, by `rmw_zenohd` or zenoh-bridge-ros2dds; no ROS is needed here."""

    host: Host = "127.0.0.1"
    """Computer of the router."""
    port: Port = 7447
    """TCP port of the router. A ground listens there, too, unless `link` says otherwise."""
    domain: Annotated[int, NoFlag, Field(ge=0, le=232)] = 0
    """The graph's ROS_DOMAIN_ID."""
    topic: Topic = "/vrpn_mocap/{body}/pose"
    """Topic of a body, of PoseStamped or Odometry; without {body} that of all bodies, of NamedPoseArray or its V2."""
    leader: Topic | None = None
    """Topic of the leader, where it is another one: of a robot that says itself where it is."""
    dds_type: PosesType | None = None
    """Type of the topics where the graph is on DDS, behind zenoh-bridge-ros2dds; rmw_zenoh's keys say it themselves."""


class MocapConfig(Model):
    """Where poses come from, and the one rotation from the mocap's axes to `lab`.

    delay_s: from exposure to receipt on the whole, what the loop's delay margin is computed with. latency_s: the part
    of it that is constant, which VRPN and QTM do not report; `gcs-log identify` estimates it; delay_s if not given.
    axes: where the mocap's own x, y and z point, such as ["x forward", "y up", "z right"], instead of q_lab_from_mocap.
    names: the lab's body for what the source calls it (Chingmu: the sensor's number), where the two differ.
    """

    source: Literal["zenoh", "csv", "vrpn", "chingmu", "nokov", "natnet", "qualisys", "vicon", "ros2"] = "zenoh"
    """Protocol by which poses arrive."""
    file: str | None = None
    """Recording that the source `csv` plays."""
    rate_hz: Positive = 100.0
    """Frames a second."""
    delay_s: Seconds = 0.008
    latency_s: Seconds | None = None
    unit: Literal["m", "cm", "mm"] | None = None
    """Length unit of the source; not given: the camera system's own."""
    axes: tuple[str, str, str] | None = None
    q_lab_from_mocap: UnitQuat = NO_ROTATION
    """Rotation from the cameras' axes to `lab`, `w, x, y, z`."""
    origin_lab_m: Vec3Tuple = (0.0, 0.0, 0.0)
    """Origin of the cameras' axes in `lab`."""
    names: dict[SourceText, Name] = Field(default_factory=dict)
    assemble_s: Annotated[float, NoFlag, Field(gt=0.0, le=0.01)] | None = None
    """Longest wait for the poses of one exposure where a body is a message of its own; not given: 2 ms, ROS 2 5 ms."""
    repeats_are_lost: Flag = True
    """Whether a pose that repeats to the last bit, of a body with noise, counts as not seen; of the same sources."""
    vrpn: VrpnConfig | None = None
    chingmu: ChingmuConfig | None = None
    nokov: NokovConfig | None = None
    natnet: NatNetConfig | None = None
    qualisys: QualisysConfig | None = None
    vicon: ViconConfig | None = None
    ros2: Ros2Config | None = None

    @property
    def unit_m(self) -> float:
        """The length of what the source counts in, m."""
        return UNITS_M[self.unit or ("mm" if self.source in MILLIMETRES else "m")]

    @property
    def constant_latency_s(self) -> float:
        """The least time from exposure to receipt."""
        return self.delay_s if self.latency_s is None else self.latency_s

    @property
    def assemble_ns(self) -> int:
        """How long a frame of a source that sends a message a body waits for its last pose."""
        return round(1e9 * (self.assemble_s or (0.005 if self.source == "ros2" else 0.002)))

    def source_name(self, body: str) -> str:
        """What the source calls the lab's body."""
        return next((theirs for theirs, ours in self.names.items() if ours == body), body)

    @model_validator(mode="before")
    @classmethod
    def _no_key_is_old(cls, values: Any) -> Any:
        if not isinstance(values, dict):
            return values
        if values.get("source") == "mavlink":
            why = 'is gone: write "zenoh", and let examples/sitl_poses.py publish what the simulators say'
            raise WrongKeyError("source", why, "mavlink")
        for system in BODY_BY_BODY:
            for key in _OLD_KEYS.keys() & (values.get(system) or ()):
                raise WrongKeyError(f"{system}.{key}", f"is gone: {_OLD_KEYS[key]}")
        return values

    @model_validator(mode="before")
    @classmethod
    def _rotation_of_axes(cls, values: Any) -> Any:
        """The one rotation, written either way; where both are, they must agree."""
        if not isinstance(values, dict) or values.get("axes") is None:
            return values
        try:
            q = rotation_of(values["axes"])
        except ValueError as error:
            raise WrongKeyError("axes", str(error).removeprefix("axes: "), values["axes"]) from error
        rotation = values.get("q_lab_from_mocap")
        if rotation is not None and max(abs(abs(a) - abs(b)) for a, b in zip(rotation, q, strict=True)) > 1e-3:
            raise WrongKeyError("axes", "q_lab_from_mocap says another rotation: give one of the two")
        return values | {"q_lab_from_mocap": q}

    @model_validator(mode="after")
    def _is_whole(self) -> Self:
        if self.source == "csv" and not self.file:
            raise WrongKeyError("file", f'is missing: source "{self.source}" needs `file`, the recording to play')
        if self.unit not in (None, "m") and self.source in IN_METRES:
            raise WrongKeyError("unit", f'source "{self.source}" is in metres', self.unit)
        if len(set(self.names.values())) < len(self.names):
            raise WrongKeyError("names", "one body has two names at the source")
        return self


def rotation_of(axes: Any) -> QuatTuple:
    """q_lab_from_mocap of named axes; ValueError for words that are none, and for axes that are not right-handed."""
    if not isinstance(axes, list | tuple) or len(axes) != 3:
        raise ValueError('axes: three are needed, such as ["x forward", "y left", "z up"]')
    columns = {}
    for text in axes:
        axis, _, pointing = str(text).partition(" ")
        if axis not in ("x", "y", "z") or pointing not in _POINTING:
            raise ValueError(f"axes: {text!r} is not x, y or z and one of {', '.join(_POINTING)}")
        columns[axis] = _POINTING[pointing]
    if len(columns) < 3:
        raise ValueError("axes: x, y and z are needed, once each")
    x, y, z = columns["x"], columns["y"], columns["z"]
    cross = (x[1] * y[2] - x[2] * y[1], x[2] * y[0] - x[0] * y[2], x[0] * y[1] - x[1] * y[0])
    if cross != z:
        raise ValueError("axes: not right-handed: two of them are swapped, or one points the other way")
    return _quaternion(x, y, z)


def _quaternion(x: _Row, y: _Row, z: _Row) -> QuatTuple:
    """Of the rotation whose columns are x, y, z; w >= 0, and where w is 0 the first other that is not is positive."""
    squares = (
        1 + x[0] + y[1] + z[2],
        1 + x[0] - y[1] - z[2],
        1 - x[0] + y[1] - z[2],
        1 - x[0] - y[1] + z[2],
    )
    w, a, b, c = (sqrt(max(square, 0.0)) / 2 for square in squares)
    if w > 0.0:
        return (w, copysign(a, y[2] - z[1]), copysign(b, z[0] - x[2]), copysign(c, x[1] - y[0]))
    if a > 0.0:
        return (0.0, a, copysign(b, x[1] + y[0]), copysign(c, x[2] + z[0]))
    return (0.0, 0.0, b, copysign(c, y[2] + z[1]) if b > 0.0 else c)

"""A flight as ROS 2 shows it: which message on which topic is made of which record. Pure.

    /tf                    tf2_msgs/TFMessage              bodies that are seen, and slots, in `lab`
    /tf_static             tf2_msgs/TFMessage              `lab` in `map`: the same place
    /diagnostics           diagnostic_msgs/DiagnosticArray phase and alarms
    BODY/pose              geometry_msgs/PoseStamped       where the cameras saw it, at the exposure
    BODY/odom              nav_msgs/Odometry               the ground's estimate; velocity in the body's own axes
    BODY/target            geometry_msgs/PoseStamped       its slot
    BODY/formation_error   geometry_msgs/Vector3Stamped    from its slot to itself, axes of `lab`
    BODY/battery_state     sensor_msgs/BatteryState

The last three are of commanded drones. Axes are those of REP-103 throughout: `lab` has z up, bodies are forward, left,
up. `map` is REP-105's name for a frame that stands still. Standard messages alone, so that no program has to be built.
"""

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from enum import IntEnum
from math import isfinite

from formation.config import LabConfig
from formation.maths.frames import one_from_yaw, rotate_one
from formation.messages import Command, Event, LabFrame, PhaseChange, Reference, Severity, SwarmState
from wire.ground_state import Alarm
from wire.logs.scene import LAB, slot_frame
from wire.ros2.message_types import Values, ros_name

TF, TF_STATIC, DIAGNOSTICS = "/tf", "/tf_static", "/diagnostics"
_POSE, _TF = "geometry_msgs/msg/PoseStamped", "tf2_msgs/msg/TFMessage"
_OF_LAB = {TF: _TF, TF_STATIC: _TF, DIAGNOSTICS: "diagnostic_msgs/msg/DiagnosticArray"}
_OF_BODY = {"pose": _POSE, "odom": "nav_msgs/msg/Odometry"}
_OF_DRONE = {
    "target": _POSE,
    "formation_error": "geometry_msgs/msg/Vector3Stamped",
    "battery_state": "sensor_msgs/msg/BatteryState",
}
_MAP = "map"
_UNKNOWN_COVARIANCE = (0.0,) * 36
_UNKNOWN_SUPPLY = (0,) * 3
"""Status, health, technology."""


class Level(IntEnum):
    """Of diagnostic_msgs/DiagnosticStatus."""

    OK = 0
    WARN = 1
    ERROR = 2


Shown = tuple[str, Values]
"""(topic, message)."""


class Flight:
    """The messages of one lab's flight. Dates are nanoseconds since 1970; ahead_ns: from stamps of records to dates."""

    def __init__(self, lab: LabConfig) -> None:
        """ValueError where the names of two bodies are one in ROS 2."""
        self._bodies = tuple(vehicle.body for vehicle in lab.vehicles)
        self._commanded = tuple(self._bodies[i] for i in lab.commanded)
        self._name = {body: ros_name(body) for body in self._bodies}
        twice = [name for name, times in Counter(self._name.values()).items() if times > 1]
        if twice:
            bodies = ", ".join(body for body, name in self._name.items() if name == twice[0])
            raise ValueError(f"{bodies}: the topics of all of them would be {twice[0]}/...: rename one")
        self._heading_rad = [0.0] * len(self._commanded)

    @property
    def types(self) -> Mapping[str, str]:
        """The type of each topic."""
        drones = {f"{self._name[body]}/{topic}": kind for body in self._commanded for topic, kind in _OF_DRONE.items()}
        bodies = {f"{name}/{topic}": kind for name in self._name.values() for topic, kind in _OF_BODY.items()}
        return _OF_LAB | bodies | drones

    def of(self, record: object, ahead_ns: int) -> Iterator[Shown]:
        """What is made of a record of control or cameras, in the order in which the log has them. ValueError for one of
        other bodies than the lab's."""
        match record:
            case LabFrame():
                yield from self._poses(record, record.t_capture_ns + ahead_ns)
            case SwarmState():
                yield from self._odometry(record, record.t_ns + ahead_ns)
            case Reference():
                self._heading_rad = record.heading_rad.tolist()
                yield from self._targets(record, record.t_ns + ahead_ns)
            case Command():
                yield from self._errors(record, record.t_ns + ahead_ns)

    def battery(self, body: str, voltage_v: float | None, share: float | None, unix_ns: int) -> Shown:
        """A drone's battery, its charge 0..1; None for what is not known, which is NaN in ROS."""
        measured = (voltage_v, *(None,) * 5, share)
        numbers = (float("nan") if number is None else number for number in measured)
        return f"{self._name[body]}/battery_state", (
            *_stamp(unix_ns), body, *numbers, *_UNKNOWN_SUPPLY, True, (), (), body, "",
        )  # fmt: skip

    def _poses(self, frame: LabFrame, unix_ns: int) -> Iterator[Shown]:
        stamp, transforms = _stamp(unix_ns), list[Values]()
        if frame.bodies != self._bodies:
            raise ValueError(f"a frame of {', '.join(frame.bodies)}")
        rows = zip(
            frame.bodies, frame.seen.tolist(), frame.pos_lab_m.tolist(), frame.q_lab_from_flu.tolist(), strict=True
        )
        for body, seen, pos_m, q in rows:
            if seen:
                pose = _pose(pos_m, q)
                transforms.append((*stamp, LAB, body, *pose))
                yield f"{self._name[body]}/pose", (*stamp, LAB, *pose)
        yield TF, (tuple(transforms),)

    def _odometry(self, state: SwarmState, unix_ns: int) -> Iterator[Shown]:
        stamp = _stamp(unix_ns)
        rows = zip(
            self._bodies, state.age_s.tolist(), state.pos_lab_m.tolist(), state.q_lab_from_flu.tolist(),
            state.vel_lab_m_s.tolist(), state.yaw_rate_rad_s.tolist(), strict=True,
        )  # fmt: skip
        for body, age_s, pos_m, q, vel_lab_m_s, yaw_rate_rad_s in rows:
            if isfinite(age_s):
                q_flu_from_lab = (q[0], -q[1], -q[2], -q[3])
                twist = (
                    *rotate_one(q_flu_from_lab, vel_lab_m_s),
                    *rotate_one(q_flu_from_lab, (0.0, 0.0, yaw_rate_rad_s)),
                )
                covered = (*_pose(pos_m, q), *_UNKNOWN_COVARIANCE, *twist, *_UNKNOWN_COVARIANCE)
                yield f"{self._name[body]}/odom", (*stamp, LAB, body, *covered)

    def _targets(self, reference: Reference, unix_ns: int) -> Iterator[Shown]:
        stamp, transforms = _stamp(unix_ns), list[Values]()
        rows = zip(
            self._commanded, reference.origin_lab_m.tolist(), self._heading_rad, reference.slot_lead_m.tolist(),
            reference.slot_yaw_rad.tolist(), strict=True,
        )  # fmt: skip
        for body, origin_m, heading_rad, slot_lead_m, yaw_rad in rows:
            slot_m = rotate_one(one_from_yaw(heading_rad), slot_lead_m)
            pose = _pose([a + b for a, b in zip(origin_m, slot_m, strict=True)], one_from_yaw(heading_rad + yaw_rad))
            transforms.append((*stamp, LAB, slot_frame(body), *pose))
            yield f"{self._name[body]}/target", (*stamp, LAB, *pose)
        yield TF, (tuple(transforms),)

    def _errors(self, command: Command, unix_ns: int) -> Iterator[Shown]:
        stamp = _stamp(unix_ns)
        for body, heading_rad, error in zip(self._commanded, self._heading_rad, command.e_lead_m.tolist(), strict=True):
            yield f"{self._name[body]}/formation_error", (*stamp, LAB, *rotate_one(one_from_yaw(heading_rad), error))


def static_frames(unix_ns: int) -> Shown:
    """The frames that stand still."""
    return TF_STATIC, (((*_stamp(unix_ns), _MAP, LAB, *(0.0,) * 6, 1.0),),)


def diagnostics(statuses: Iterable[Values], unix_ns: int) -> Shown:
    """Statuses at a date."""
    return DIAGNOSTICS, (*_stamp(unix_ns), "", tuple(statuses))


def phase_status(change: PhaseChange) -> Values:
    """The flight's phase."""
    return Level.OK, "formation: phase", f"{change.phase.name}: {change.cause}", "", (("cause", change.code),)


def fault_status(fault: Event | Alarm, is_over: bool) -> Values:
    """An alarm, or an event; one of the same condition has the same name."""
    level = Level.OK if is_over or fault.severity > Severity.WARNING else Level.WARN
    level = Level.ERROR if level == Level.WARN and fault.severity <= Severity.ERROR else level
    name = " ".join(filter(None, fault.key))
    return level, f"formation: {name}", fault.text, fault.subject, (("severity", fault.severity.name),)


def _stamp(unix_ns: int) -> tuple[int, int]:
    return divmod(unix_ns, 1_000_000_000)


def _pose(pos_m: Sequence[float], q: Sequence[float]) -> Values:
    """geometry_msgs/Pose, and Transform, of a position and a quaternion w x y z."""
    return *pos_m, q[1], q[2], q[3], q[0]

"""What viewers are shown beside our own channels: one state and one link a drone, the scene, frames, log lines.

    /drone/<body>/state   DroneState      /tf             foxglove.FrameTransforms    /log   foxglove.Log
    /drone/<body>/link    DroneLink       /scene, /scene/trails   foxglove.SceneUpdate

Views, not the record: thinned to what an eye can follow, in floats; every bit and every frame is on our own channels.
One drone's estimate, reference and command are one small message with named fields, for plots by name:

    message DroneState {
      Vector pos = 1; vel = 2;   // lab, m, m/s          Vector err = 6;   // formation error, lead, m
      Angles att = 3;            // lab from flu, rad     Vector acc = 7;   // demanded, lab, m/s^2
      Vector dist = 4;           // Z3, lab, m/s^2        float thrust = 8; // 0..1
      Vector ref = 5;            // reference, lab, m     float age_s = 9;  // since it was last seen
    }                            // Vector: float x, y, z; Angles: float roll, pitch, yaw; about x, y, z, in that order

A body that is only observed has no ref, err, acc and thrust. All drones of a tick are packed at once, since this is in
the control loop's time.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from google.protobuf import descriptor_pb2
from mcap_protobuf.schema import build_file_descriptor_set
from numpy.typing import NDArray

from formation import messages as m
from formation import topics
from formation.config import LabConfig
from formation.maths.arrays import Float, Quats, Vec3s
from formation.messages import Datagram
from formation.topics import Topic
from wire.link_messages import GROUND, Battery, ExtendedSysState, Heartbeat, LandedState, NamedValue, Packet, SysStatus
from wire.logs import scene
from wire.mavlink.codec import Codec
from wire.schema import BYTES, FIXED32, schema_of

STATE_NAME = "formation.DroneState"
_VECTORS = ("pos", "vel", "att", "dist", "ref", "err", "acc")
_SCALARS = ("thrust", "age_s")
_COMMANDED_ALONE = frozenset({"ref", "err", "acc", "thrust"})
_PARTS = {"Vector": ("x", "y", "z"), "Angles": ("roll", "pitch", "yaw")}


def state_descriptor() -> bytes:
    """The FileDescriptorSet of DroneState."""
    file = descriptor_pb2.FileDescriptorProto(name="formation/DroneState.proto", package="formation", syntax="proto3")
    message = file.message_type.add(name="DroneState")
    kinds = descriptor_pb2.FieldDescriptorProto
    for name, parts in _PARTS.items():
        nested = message.nested_type.add(name=name)
        for number, part in enumerate(parts, start=1):
            nested.field.add(name=part, number=number, label=kinds.LABEL_OPTIONAL, type=kinds.TYPE_FLOAT)
    for number, name in enumerate(_VECTORS, start=1):
        kind = f".{STATE_NAME}.{'Angles' if name == 'att' else 'Vector'}"
        message.field.add(name=name, number=number, label=kinds.LABEL_OPTIONAL, type=kinds.TYPE_MESSAGE, type_name=kind)
    for number, name in enumerate(_SCALARS, start=len(_VECTORS) + 1):
        message.field.add(name=name, number=number, label=kinds.LABEL_OPTIONAL, type=kinds.TYPE_FLOAT)
    return descriptor_pb2.FileDescriptorSet(file=[file]).SerializeToString()


class _Rows:
    """The messages of several drones as rows of one buffer, whose tags stand and whose numbers are set."""

    def __init__(self, count: int, fields: frozenset[str]) -> None:
        template = b""
        offsets: dict[str, int] = {}
        for number, name in enumerate((*_VECTORS, *_SCALARS), start=1):
            if name not in fields:
                continue
            if name in _VECTORS:
                template += bytes((number << 3 | BYTES, 3 * 5))
                offsets[name] = len(template) + 1
                template += b"".join(bytes((part << 3 | FIXED32, 0, 0, 0, 0)) for part in (1, 2, 3))
            else:
                offsets[name] = len(template) + 1
                template += bytes((number << 3 | FIXED32, 0, 0, 0, 0))
        self._count, self._size = count, len(template)
        self._bytes = np.tile(np.frombuffer(template, np.uint8), count)
        self._of: dict[str, NDArray[np.float32]] = {
            name: np.ndarray(
                (count, 3) if name in _VECTORS else (count,), "<f4", self._bytes.data, offset,
                (self._size, 5) if name in _VECTORS else (self._size,),
            )
            for name, offset in offsets.items()
        }  # fmt: skip

    def pack(self, values: Mapping[str, Float]) -> list[bytes]:
        """values: (count, 3) or (count,) of each field."""
        for name, target in self._of.items():
            target[...] = values[name]
        data, size = self._bytes.tobytes(), self._size
        return [data[at : at + size] for at in range(0, self._count * size, size)]


class DroneStates:
    """Packs the states of n vehicles of which those at `commanded` are commanded."""

    def __init__(self, count: int, commanded: tuple[int, ...]) -> None:
        every = frozenset((*_VECTORS, *_SCALARS))
        self._count = count
        self._own = np.array(commanded, np.intp)
        self._observed = np.array([i for i in range(count) if i not in commanded], np.intp)
        self._rows = [
            (index, _Rows(len(index), fields))
            for index, fields in ((self._own, every), (self._observed, every - _COMMANDED_ALONE))
            if len(index)
        ]

    def pack(
        self, state: m.SwarmState, reference: m.Reference, command: m.Command, target: m.AttitudeTarget
    ) -> list[tuple[int, bytes]]:  # fmt: skip
        """(index of the vehicle, its message) of each; nothing where the messages are of other vehicles."""
        if len(state.pos_lab_m) != self._count or len(command.e_lead_m) != len(self._own):
            return []
        values = {
            "pos": state.pos_lab_m, "vel": state.vel_lab_m_s, "att": angles(state.q_lab_from_flu),
            "dist": state.dist_lab_m_s2, "age_s": state.age_s,
        }  # fmt: skip
        own = {
            "ref": reference_lab(reference), "err": command.e_lead_m, "acc": command.acc_lab_m_s2,
            "thrust": target.thrust_norm,
        }  # fmt: skip
        packed: list[tuple[int, bytes]] = []
        for index, rows in self._rows:
            packed += zip(index.tolist(), rows.pack({k: of[index] for k, of in values.items()} | own), strict=True)
        return packed


def reference_lab(reference: m.Reference) -> Vec3s:
    """Where each commanded vehicle should be, lab, m: its slot carried by its `lead` frame."""
    x, y = reference.slot_lead_m[:, 0], reference.slot_lead_m[:, 1]
    c, s = np.cos(reference.heading_rad), np.sin(reference.heading_rad)
    turned = np.stack([c * x - s * y, s * x + c * y, reference.slot_lead_m[:, 2]], axis=1)
    return np.asarray(reference.origin_lab_m + turned, np.float64)


def angles(q_lab_from_flu: Quats) -> Vec3s:
    """Roll, pitch and yaw (n, 3), rad: turns about z, then y, then x; positive pitch is nose down."""
    w, x, y, z = q_lab_from_flu.T
    roll = np.arctan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))
    pitch = np.arcsin(np.clip(2.0 * (w * y - z * x), -1.0, 1.0))
    yaw = np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
    return np.stack([roll, pitch, yaw], axis=1)


RARE = frozenset({0, 1, 147, 245})
"""HEARTBEAT, SYS_STATUS, BATTERY_STATUS, EXTENDED_SYS_STATE."""
READS = RARE | {251}
"""And NAMED_VALUE_FLOAT; other messages are not decoded."""
AGE_NAME = "age_ms"
"""Of a setpoint's age, as drones report it."""
_NAN = float("nan")


@dataclass(frozen=True, slots=True)
class DroneLink:
    """What a drone last said: pack voltage, V; charge, 0..1; what is not known is NaN.

    setpoint_age_ms: camera to drone; silent_s: since its last packet; received, lost: packets, by their numbers.
    landed: MAV_LANDED_STATE; custom_mode: its make's own number of its mode.
    """

    battery_v: float = _NAN
    battery: float = _NAN
    setpoint_age_ms: float = _NAN
    silent_s: float = _NAN
    received: int = 0
    lost: int = 0
    armed: bool = False
    landed: LandedState = LandedState.UNDEFINED
    custom_mode: int = 0


class LinkView:
    """The link state of one drone, from the datagrams that it sends."""

    def __init__(self, sysid: int) -> None:
        self._sysid = sysid
        self._codec = Codec(GROUND, reads=READS)
        self._battery_v = self._battery = self._age_ms = _NAN
        self._received = self._lost = 0
        self._seq: int | None = None
        self._received_ns: int | None = None
        self._armed, self._mode, self._landed = False, 0, LandedState.UNDEFINED

    def receive(self, datagram: Datagram, t_ns: int) -> None:
        """Receive a datagram of the drone."""
        for packet in self._codec.receive(datagram.data):
            self.update(packet, t_ns)

    def update(self, packet: Packet, t_ns: int) -> None:
        """Receive a packet of any drone, of a message not in READS as UnknownMessage."""
        if packet.source.system != self._sysid:
            return
        self._received_ns = t_ns
        self._received += 1
        self._lost, self._seq = lost_by((self._lost, self._seq), packet.seq)
        match packet.message:
            case Heartbeat() as heartbeat if packet.source.component == 1:
                self._armed, self._mode = heartbeat.armed, heartbeat.custom_mode
            case SysStatus() as status:
                self._battery_v, self._battery = status.battery_v, _share(status.battery_remaining)
            case Battery() as battery:
                self._battery_v, self._battery = sum(battery.cell_v), _share(battery.remaining)
            case ExtendedSysState() as state:
                self._landed = state.landed
            case NamedValue(name=name) as age if name == AGE_NAME:
                self._age_ms = age.value

    def now(self, t_ns: int) -> DroneLink:
        """The link state at `t_ns`."""
        silent_s = _NAN if self._received_ns is None else (t_ns - self._received_ns) * 1e-9
        return DroneLink(
            self._battery_v, self._battery, self._age_ms, silent_s, self._received, self._lost,
            self._armed, self._landed, self._mode,
        )  # fmt: skip


Losses = tuple[int, int | None]
"""How many packets are lost; the newest one's number."""


def lost_by(before: Losses, seq: int) -> Losses:
    """The losses with one more packet; before: without it.

    A step of more than half the circle is a packet overtaken on the way: it was counted as lost.
    """
    lost, newest = before
    step = 1 if newest is None else (seq - newest) % 256
    if step == 0 or step > 128:
        return max(lost - 1, 0), newest
    return lost + step - 1, seq


def _share(remaining: float) -> float:
    return remaining if 0.0 <= remaining <= 1.0 else _NAN


LINK_NS = 1_000_000_000
"""Between two shown states of a link."""
CALM_NS = 100_000_000
"""The least spacing of frames while nobody is armed."""
CALM = frozenset({m.Phase.GROUND})
LINES = frozenset({topics.EVENT.name, topics.MOCAP_EVENT.name, topics.REJECTED.name})

AddChannel = Callable[[str, str, bytes], int]
"""(topic, schema's name, descriptor set) -> the channel's number."""
Shown = tuple[int, bytes]
"""(channel, message)."""


class Views:
    """The views of one log, made of its records as they are written. Without a lab there are log lines alone."""

    def __init__(self, lab: LabConfig | None, add_channel: AddChannel) -> None:
        self._lab = lab
        self._log = add_channel("/log", *_foxglove(Log))
        self._flight = None if lab is None else _Flight(lab, add_channel)

    def of(self, topic: Topic, message: object, t_ns: int, unix_ns: int) -> Iterator[Shown]:
        """What a record shows. t_ns: its stamp; unix_ns: the date of that."""
        if isinstance(message, m.Event):
            if topic.name in LINES:
                yield self._log, scene.log_line(message, unix_ns)
        elif self._flight is not None:
            yield from self._flight.of(topic, message, t_ns, unix_ns)


class _Flight:
    def __init__(self, lab: LabConfig, add_channel: AddChannel) -> None:
        self._lab = lab
        self._bodies = tuple(vehicle.body for vehicle in lab.vehicles)
        self._commanded = tuple(self._bodies[i] for i in lab.commanded)
        described = STATE_NAME, state_descriptor()
        self._state_of = [add_channel(f"/drone/{body}/state", *described) for body in self._bodies]
        link = schema_of(DroneLink)
        self._link_of = {
            vehicle.sysid: (
                add_channel(f"/drone/{vehicle.body}/link", link.name, link.descriptor_set),
                LinkView(vehicle.sysid),
            )
            for vehicle in lab.vehicles
            if vehicle.sysid is not None
        }
        self._encode_link = link.encode
        self._tf = add_channel("/tf", *_foxglove(FrameTransforms))
        self._scene = add_channel("/scene", *_foxglove(SceneUpdate))
        self._trails = add_channel("/scene/trails", *_foxglove(SceneUpdate))
        self._states = DroneStates(len(self._bodies), lab.commanded)
        self._next_ns: dict[str, int] = {}
        """When each view may be shown again, at the earliest."""
        self._tick: dict[type, object] = {}
        self._trails_m: list[list[tuple[float, float, float]]] = [[] for _ in self._bodies]
        self._calm_ns = CALM_NS

    def _is_due(self, view: str, t_ns: int, spacing_ns: int) -> bool:
        """Whether a view is shown now; if so, the next is shown no earlier than the spacing later."""
        is_due = t_ns >= self._next_ns.get(view, 0)
        if is_due:
            self._next_ns[view] = t_ns + spacing_ns
        return is_due

    def of(self, topic: Topic, message: object, t_ns: int, unix_ns: int) -> Iterator[Shown]:
        match message:
            case m.LabFrame():
                yield from self._frame(message, t_ns, unix_ns)
            case m.SwarmState() | m.Reference() | m.Command():
                self._tick[type(message)] = message
            case m.AttitudeTarget():
                yield from self._control(message, t_ns, unix_ns)
            case m.Datagram() if topic is topics.LINK_UP and message.sysid in self._link_of:
                self._link_of[message.sysid][1].receive(message, t_ns)
            case m.Tick() if self._is_due("link", t_ns, LINK_NS):
                for channel, view in self._link_of.values():
                    yield channel, self._encode_link(view.now(t_ns))
            case m.PhaseChange():
                self._calm_ns = CALM_NS if message.phase in CALM else 0

    def _frame(self, frame: m.LabFrame, t_ns: int, unix_ns: int) -> Iterator[Shown]:
        if self._is_due("scene", t_ns, 10_000_000_000):
            yield self._scene, scene.lab_scene(self._lab, unix_ns)
        if self._is_due("bodies", t_ns, max(70_000_000, self._calm_ns)):
            yield self._tf, scene.bodies(frame, unix_ns)
        if self._calm_ns or frame.bodies != self._bodies:
            return
        if self._is_due("point", t_ns, 200_000_000):
            for trail_m, pos, seen in zip(self._trails_m, frame.pos_lab_m.tolist(), frame.seen.tolist(), strict=True):
                if seen:
                    trail_m.append(tuple(pos))
        if self._is_due("trail", t_ns, 2_000_000_000):
            yield self._trails, scene.trails(self._trails_m, self._bodies, unix_ns)
            self._trails_m = [trail_m[-1:] for trail_m in self._trails_m]

    def _control(self, target: m.AttitudeTarget, t_ns: int, unix_ns: int) -> Iterator[Shown]:
        state, reference, command = (self._tick.get(kind) for kind in (m.SwarmState, m.Reference, m.Command))
        if not isinstance(reference, m.Reference) or len(reference.slot_lead_m) != len(self._commanded):
            return
        if self._is_due("slots", t_ns, max(200_000_000, self._calm_ns)):
            yield self._tf, scene.slots(self._commanded, reference_lab(reference), unix_ns)
        if not isinstance(state, m.SwarmState) or not isinstance(command, m.Command):
            return
        if self._is_due("state", t_ns, max(70_000_000, self._calm_ns)):
            for i, data in self._states.pack(state, reference, command, target):
                yield self._state_of[i], data


def _foxglove(message: type[FrameTransforms | Log | SceneUpdate]) -> tuple[str, bytes]:
    """Name and descriptor set of one of Foxglove's own schemas."""
    return message.DESCRIPTOR.full_name, build_file_descriptor_set(message).SerializeToString()

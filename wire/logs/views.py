"""What viewers are shown beside our own channels: one state and one link a drone, the scene, frames, log lines.

    /drone/<body>/state   DroneState      /tf             foxglove.FrameTransforms    /log   foxglove.Log
    /drone/<body>/link    DroneLink       /scene, /scene/trails   foxglove.SceneUpdate

Views, not the record: thinned to what an eye can follow, in floats; every bit and every frame is on our own channels.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from mcap_protobuf.schema import build_file_descriptor_set

from formation import messages as m
from formation import topics
from formation.config import LabConfig
from formation.topics import Topic
from wire.logs import drone_state, scene
from wire.logs.drone_link import DroneLink, LinkView
from wire.logs.drone_state import DroneStates, reference_lab
from wire.schema import schema_of

STATE_NS, FRAMES_NS, SLOTS_NS, LINK_NS = 70_000_000, 70_000_000, 200_000_000, 1_000_000_000
POINT_NS, TRAIL_NS, SCENE_NS = 200_000_000, 2_000_000_000, 10_000_000_000
CALM_NS = 100_000_000
"""The least spacing of frames while nobody is armed."""
CALM = frozenset({m.Phase.GROUND})
LINES = frozenset({topics.EVENT.name, topics.MOCAP_EVENT.name, topics.REJECTED.name})

AddChannel = Callable[[str, str, bytes], int]
"""(topic, schema's name, descriptor set) -> the channel's number."""
Shown = tuple[int, bytes]
"""(channel, message)."""


@dataclass(slots=True)
class _RateLimiter:
    """Lets something pass at most once every `spacing_ns`."""

    spacing_ns: int
    next_ns: int = 0

    def due(self, t_ns: int, at_least_ns: int = 0) -> bool:
        """Whether it passes now; if so, the next may pass `spacing_ns` or `at_least_ns` later."""
        if t_ns < self.next_ns:
            return False
        self.next_ns = t_ns + max(self.spacing_ns, at_least_ns)
        return True


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
        described = drone_state.NAME, drone_state.descriptor_set()
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
        self._limiters = {
            "state": _RateLimiter(STATE_NS),
            "tf": _RateLimiter(FRAMES_NS),
            "slots": _RateLimiter(SLOTS_NS),
        }
        self._slow_limiters = {
            "link": _RateLimiter(LINK_NS),
            "scene": _RateLimiter(SCENE_NS),
            "point": _RateLimiter(POINT_NS),
            "trail": _RateLimiter(TRAIL_NS),
        }
        self._tick: dict[type, object] = {}
        self._trails_m: list[list[tuple[float, float, float]]] = [[] for _ in self._bodies]
        self._calm_ns = CALM_NS

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
            case m.Tick() if self._slow_limiters["link"].due(t_ns):
                for channel, view in self._link_of.values():
                    yield channel, self._encode_link(view.now(t_ns))
            case m.PhaseChange():
                self._calm_ns = CALM_NS if message.phase in CALM else 0

    def _frame(self, frame: m.LabFrame, t_ns: int, unix_ns: int) -> Iterator[Shown]:
        if self._slow_limiters["scene"].due(t_ns):
            yield self._scene, scene.lab_scene(self._lab, unix_ns)
        if self._limiters["tf"].due(t_ns, self._calm_ns):
            yield self._tf, scene.bodies(frame, unix_ns)
        if self._calm_ns or frame.bodies != self._bodies:
            return
        if self._slow_limiters["point"].due(t_ns):
            for trail_m, pos, seen in zip(self._trails_m, frame.pos_lab_m.tolist(), frame.seen.tolist(), strict=True):
                if seen:
                    trail_m.append(tuple(pos))
        if self._slow_limiters["trail"].due(t_ns):
            yield self._trails, scene.trails(self._trails_m, self._bodies, unix_ns)
            self._trails_m = [trail_m[-1:] for trail_m in self._trails_m]

    def _control(self, target: m.AttitudeTarget, t_ns: int, unix_ns: int) -> Iterator[Shown]:
        state, reference, command = (self._tick.get(kind) for kind in (m.SwarmState, m.Reference, m.Command))
        if not isinstance(reference, m.Reference) or len(reference.slot_lead_m) != len(self._commanded):
            return
        if self._limiters["slots"].due(t_ns, self._calm_ns):
            yield self._tf, scene.slots(self._commanded, reference_lab(reference), unix_ns)
        if not isinstance(state, m.SwarmState) or not isinstance(command, m.Command):
            return
        if self._limiters["state"].due(t_ns, self._calm_ns):
            for i, data in self._states.pack(state, reference, command, target):
                yield self._state_of[i], data


def _foxglove(message: type[FrameTransforms | Log | SceneUpdate]) -> tuple[str, bytes]:
    """Name and descriptor set of one of Foxglove's own schemas."""
    return message.DESCRIPTOR.full_name, build_file_descriptor_set(message).SerializeToString()

"""The flight as Foxglove draws it: frames of bodies and slots, drones, fence and trails, log lines; and as Rerun does.

An entity is drawn once and moves with its frame, so that only the frames' transforms are sent often.
"""

from collections.abc import Iterable, Sequence
from itertools import combinations, product
from operator import ne
from typing import Any

from foxglove_schemas_protobuf.Color_pb2 import Color
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.LinePrimitive_pb2 import LinePrimitive
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.SceneEntity_pb2 import SceneEntity
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from google.protobuf.duration_pb2 import Duration
from google.protobuf.timestamp_pb2 import Timestamp

from formation import messages as m
from formation.config import Fence, LabConfig
from formation.maths.arrays import Vec3s
from wire.logs import ALARM, COLOURS

LAB = "lab"
TRAIL_S = 10
THICK_M = 0.03
_LEVELS = {
    m.Severity.DEBUG: Log.DEBUG,
    m.Severity.INFO: Log.INFO,
    m.Severity.NOTICE: Log.INFO,
    m.Severity.WARNING: Log.WARNING,
    m.Severity.ERROR: Log.ERROR,
    m.Severity.CRITICAL: Log.FATAL,
    m.Severity.ALERT: Log.FATAL,
    m.Severity.EMERGENCY: Log.FATAL,
}


def slot_frame(body: str) -> str:
    """The name of the frame of a body's slot, or of whatever its reference is."""
    return f"slot/{body}"


def bodies(frame: m.LabFrame, unix_ns: int) -> bytes:
    """Where the bodies are that were seen, as frames of their names in `lab`."""
    rows = zip(frame.bodies, frame.pos_lab_m.tolist(), frame.q_lab_from_flu.tolist(), frame.seen.tolist(), strict=True)
    return _transforms(((body, pos, q) for body, pos, q, seen in rows if seen), unix_ns)


def slots(names: Sequence[str], pos_lab_m: Vec3s, unix_ns: int) -> bytes:
    """Where these bodies should be, as frames in `lab`."""
    rows = zip(names, pos_lab_m.tolist(), strict=True)
    return _transforms(((slot_frame(body), pos, (1.0, 0.0, 0.0, 0.0)) for body, pos in rows), unix_ns)


def _transforms(rows: Iterable[tuple[str, Sequence[float], Sequence[float]]], unix_ns: int) -> bytes:
    """Frames in `lab`: the name, place and quaternion (w x y z) of each."""
    transforms, stamp = FrameTransforms(), _stamp(unix_ns)
    for name, (x, y, z), (qw, qx, qy, qz) in rows:
        transform = transforms.transforms.add(timestamp=stamp, parent_frame_id=LAB, child_frame_id=name)
        translation, rotation = transform.translation, transform.rotation
        translation.x, translation.y, translation.z = x, y, z
        rotation.x, rotation.y, rotation.z, rotation.w = qx, qy, qz, qw
    return _bytes(transforms)


def lab_scene(lab: LabConfig, unix_ns: int) -> bytes:
    """All entities of the scene: the fence, the drones in true size with nose and name, and the slots."""
    update = SceneUpdate()
    stamp = _stamp(unix_ns)
    _fence(update.entities.add(timestamp=stamp, frame_id=LAB, id="fence"), lab.limits.fence)
    for i, vehicle in enumerate(lab.vehicles):
        colour = COLOURS[i % len(COLOURS)]
        size_m = max(2.0 * lab.profile_of(vehicle).reach_m, THICK_M)
        drone = update.entities.add(timestamp=stamp, frame_id=vehicle.body, id=f"drone/{vehicle.body}")
        drone.frame_locked = True
        disc = drone.cylinders.add(color=_colour(colour, 0.9), bottom_scale=1.0, top_scale=1.0)
        disc.size.x, disc.size.y, disc.size.z = size_m, size_m, THICK_M
        disc.pose.orientation.w = 1.0
        nose = drone.arrows.add(
            color=_colour(colour, 1.0), shaft_length=size_m, shaft_diameter=THICK_M / 2.0,
            head_length=THICK_M, head_diameter=THICK_M,
        )  # fmt: skip
        nose.pose.orientation.w = 1.0
        name = drone.texts.add(text=vehicle.body, color=_colour(colour, 1.0), font_size=14.0)
        name.billboard = name.scale_invariant = True
        name.pose.position.z, name.pose.orientation.w = 2.0 * THICK_M, 1.0
        if vehicle.sysid is not None:
            slot = update.entities.add(timestamp=stamp, frame_id=slot_frame(vehicle.body), id=f"slot/{vehicle.body}")
            slot.frame_locked = True
            ball = slot.spheres.add(color=_colour(colour, 0.35))
            ball.size.x = ball.size.y = ball.size.z = size_m
            ball.pose.orientation.w = 1.0
    return _bytes(update)


def trails(points: Sequence[Sequence[tuple[float, float, float]]], names: Sequence[str], unix_ns: int) -> bytes:
    """The newest part of each body's path, lab, m; it fades after TRAIL_S."""
    update = SceneUpdate()
    for i, (body, trail_m) in enumerate(zip(names, points, strict=True)):
        entity = update.entities.add(
            timestamp=_stamp(unix_ns), frame_id=LAB, id=f"trail/{body}/{unix_ns}", lifetime=Duration(seconds=TRAIL_S)
        )
        line = entity.lines.add(type=LinePrimitive.LINE_STRIP, thickness=2.0, scale_invariant=True)
        line.pose.orientation.w = 1.0
        line.color.CopyFrom(_colour(COLOURS[i % len(COLOURS)], 0.8))
        for x, y, z in trail_m:
            line.points.add(x=x, y=y, z=z)
    return _bytes(update)


def log_line(event: m.Event, unix_ns: int) -> bytes:
    """An event as a line of Foxglove's log panel."""
    return _bytes(Log(timestamp=_stamp(unix_ns), level=_LEVELS[event.severity], name=event.source, message=event.text))


def _fence(entity: SceneEntity, fence: Fence) -> None:
    """The twelve edges of the box."""
    lines = entity.lines.add(type=LinePrimitive.LINE_LIST, thickness=1.5, scale_invariant=True)
    lines.pose.orientation.w = 1.0
    lines.color.CopyFrom(_colour(ALARM, 0.7))
    for a, b in combinations(product((0, 1), repeat=3), 2):
        if sum(map(ne, a, b)) == 1:  # corners that differ on one axis
            for corner in (a, b):
                x, y, z = (fence.high_m[k] if up else fence.low_m[k] for k, up in enumerate(corner))
                lines.points.add(x=x, y=y, z=z)


def _colour(code: str, alpha: float) -> Color:
    red, green, blue = (channel / 255.0 for channel in bytes.fromhex(code.removeprefix("#")))
    return Color(r=red, g=green, b=blue, a=alpha)


def _stamp(t_ns: int) -> Timestamp:
    return Timestamp(seconds=t_ns // 1_000_000_000, nanos=t_ns % 1_000_000_000)


def _bytes(message: FrameTransforms | SceneUpdate | Log) -> bytes:
    data: bytes = message.SerializeToString()
    return data


def rerun_blueprint(bodies: Sequence[str]) -> Any:
    """The blueprint for these bodies, leader first; ImportError where rerun-sdk is missing."""
    import rerun.blueprint as rrb

    drones = [rrb.DataframeView(origin=f"/drone/{body}/state", name=f"{body}: state") for body in bodies]
    links = [rrb.DataframeView(origin=f"/drone/{body}/link", name=f"{body}: battery and link") for body in bodies]
    return rrb.Blueprint(
        rrb.Horizontal(
            rrb.Spatial3DView(
                origin="/",
                name="Room",
                spatial_information=rrb.SpatialInformation(target_frame=LAB),
                eye_controls=rrb.EyeControls3D(position=(-2.2, -1.6, 1.6), look_target=(0.0, 0.0, 0.3)),
            ),
            rrb.Vertical(rrb.Tabs(*drones), rrb.Tabs(*links), rrb.TextLogView(origin="/log", name="Log")),
            column_shares=[3, 2],
        )
    )

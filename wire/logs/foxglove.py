"""The Foxglove view of a log: poses, transforms and log lines in Foxglove's own schemas, beside our channels.

A view, not the record: positions are thinned to what an eye can follow; the full rate is on our own channels.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.PosesInFrame_pb2 import PosesInFrame
from google.protobuf.timestamp_pb2 import Timestamp
from mcap_protobuf.schema import build_file_descriptor_set

from formation import messages as m

_LAB = "lab"
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


@dataclass(frozen=True, slots=True)
class View:
    """One Foxglove channel made from one of our messages; at least `spacing_ns` between its entries."""

    channel: str
    schema_name: str
    descriptor_set: bytes
    encode: Callable[[Any, int], bytes]
    spacing_ns: int


def _poses(frame: m.LabFrame, t_ns: int) -> bytes:
    poses = PosesInFrame(timestamp=_stamp(t_ns), frame_id=_LAB)
    for (x, y, z), (qw, qx, qy, qz) in zip(frame.pos_lab_m.tolist(), frame.q_lab_from_flu.tolist(), strict=True):
        pose = poses.poses.add()
        pose.position.x, pose.position.y, pose.position.z = x, y, z
        rotation = pose.orientation
        rotation.x, rotation.y, rotation.z, rotation.w = qx, qy, qz, qw
    data: bytes = poses.SerializeToString()
    return data


def _transforms(frame: m.LabFrame, t_ns: int) -> bytes:
    transforms = FrameTransforms()
    stamp = _stamp(t_ns)
    rows = zip(frame.bodies, frame.pos_lab_m.tolist(), frame.q_lab_from_flu.tolist(), strict=True)
    for body, (x, y, z), (qw, qx, qy, qz) in rows:
        transform = transforms.transforms.add(timestamp=stamp, parent_frame_id=_LAB, child_frame_id=body)
        translation, rotation = transform.translation, transform.rotation
        translation.x, translation.y, translation.z = x, y, z
        rotation.x, rotation.y, rotation.z, rotation.w = qx, qy, qz, qw
    data: bytes = transforms.SerializeToString()
    return data


def _log(event: m.Event, t_ns: int) -> bytes:
    level = _LEVELS[event.severity]
    data: bytes = Log(timestamp=_stamp(t_ns), level=level, name=event.source, message=event.text).SerializeToString()
    return data


def _stamp(t_ns: int) -> Timestamp:
    return Timestamp(seconds=t_ns // 1_000_000_000, nanos=t_ns % 1_000_000_000)


def _view(channel: str, message: type[Any], encode: Callable[[Any, int], bytes], spacing_ns: int) -> View:
    descriptor_set = build_file_descriptor_set(message).SerializeToString()
    return View(channel, message.DESCRIPTOR.full_name, descriptor_set, encode, spacing_ns)


def views_of(message: type) -> tuple[View, ...]:
    """The Foxglove views of one of our message types; most have none."""
    if message is m.LabFrame:
        spacing_ns = 30_000_000
        return (
            _view("foxglove/poses", PosesInFrame, _poses, spacing_ns),
            _view("foxglove/transforms", FrameTransforms, _transforms, spacing_ns),
        )
    if message is m.Event:
        return (_view("foxglove/log", Log, _log, 0),)
    return ()

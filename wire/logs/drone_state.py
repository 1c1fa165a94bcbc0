"""One drone's estimate, reference and command as one small message with named fields, for plots by name.

    message DroneState {
      Vector pos = 1; vel = 2;   // lab, m, m/s          Vector err = 6;   // formation error, lead, m
      Angles att = 3;            // lab from flu, rad     Vector acc = 7;   // demanded, lab, m/s^2
      Vector dist = 4;           // Z3, lab, m/s^2        float thrust = 8; // 0..1
      Vector ref = 5;            // reference, lab, m     float age_s = 9;  // since it was last seen
    }                            // Vector: float x, y, z; Angles: float roll, pitch, yaw; about x, y, z, in that order

A view of the four control channels, in floats: those hold every bit. A body that is only observed has no ref, err, acc
and thrust. All drones of a tick are packed at once, since this is in the control loop's time.
"""

import struct
from collections.abc import Mapping

import numpy as np
from google.protobuf import descriptor_pb2
from numpy.typing import NDArray

from formation import messages as m
from formation.maths.arrays import Float, Quats, Vec3s

NAME = "formation.DroneState"
_VECTORS = ("pos", "vel", "att", "dist", "ref", "err", "acc")
_SCALARS = ("thrust", "age_s")
_COMMANDED_ALONE = frozenset({"ref", "err", "acc", "thrust"})
_PARTS = {"Vector": ("x", "y", "z"), "Angles": ("roll", "pitch", "yaw")}
_LENGTH, _FIXED32 = 2, 5
_VECTOR_SIZE = 3 * 5


def descriptor_set() -> bytes:
    """The FileDescriptorSet of DroneState."""
    file = descriptor_pb2.FileDescriptorProto(name="formation/DroneState.proto", package="formation", syntax="proto3")
    message = file.message_type.add(name="DroneState")
    kinds = descriptor_pb2.FieldDescriptorProto
    for name, parts in _PARTS.items():
        nested = message.nested_type.add(name=name)
        for number, part in enumerate(parts, start=1):
            nested.field.add(name=part, number=number, label=kinds.LABEL_OPTIONAL, type=kinds.TYPE_FLOAT)
    for number, name in enumerate(_VECTORS, start=1):
        kind = f".{NAME}.{'Angles' if name == 'att' else 'Vector'}"
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
                template += bytes((number << 3 | _LENGTH, _VECTOR_SIZE))
                offsets[name] = len(template) + 1
                template += b"".join(bytes((part << 3 | _FIXED32, 0, 0, 0, 0)) for part in (1, 2, 3))
            else:
                offsets[name] = len(template) + 1
                template += bytes((number << 3 | _FIXED32, 0, 0, 0, 0))
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


def floats_of(data: bytes) -> dict[str, tuple[float, ...]]:
    """The fields of one packed message, as a viewer without Protobuf's own library needs them (gcs.live)."""
    names = dict(enumerate((*_VECTORS, *_SCALARS), start=1))
    found: dict[str, tuple[float, ...]] = {}
    at = 0
    while at < len(data):
        number, vector = data[at] >> 3, data[at] & 7 == _LENGTH
        found[names[number]] = struct.unpack_from("<xfxfxf" if vector else "<f", data, at + (2 if vector else 1))
        at += 2 + _VECTOR_SIZE if vector else 5
    return found

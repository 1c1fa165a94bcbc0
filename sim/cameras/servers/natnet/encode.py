"""NatNet's packets as a server writes them. Rigid bodies and their markers; all else is empty."""

from collections.abc import Mapping
from dataclasses import dataclass
from struct import Struct, pack

import numpy as np
from numpy.typing import NDArray

from formation.maths.arrays import Float
from formation.messages import RawFrame

Version = tuple[int, int]
MESSAGE = Struct("<HH")
SERVER_INFO, RESPONSE, MODELS, FRAME, ECHO_RESPONSE, UNRECOGNIZED = 1, 3, 5, 7, 13, 100
BODY = np.dtype([("id", "<i4"), ("pos", "<f4", 3), ("q_xyzw", "<f4", 4), ("error", "<f4"), ("params", "<i2")])
MARKER = np.dtype([("id", "<i4"), ("pos", "<f4", 3), ("size", "<f4"), ("params", "<i2"), ("residual", "<f4")])
SOLVED, HIDDEN = 0x0A, 0x09
"""A marker of a model: seen, or occluded."""
OFFSETS_M = np.array([[0.06, 0.0, 0.02], [-0.05, 0.03, 0.02], [-0.04, -0.05, 0.03], [0.0, 0.06, 0.04]])
"""Where each body's markers are on it; no two of its sides are alike."""
MARKER_SIZE_M, ERROR_M = 0.014, 0.0003
MOTIVE = {(3, 0): (2, 1), (3, 1): (2, 2), (4, 0): (3, 0), (4, 1): (3, 1), (4, 2): (3, 2)}
"""Which release streams which version of NatNet."""
ALL = "all"
"""The marker set of every marker."""


@dataclass(frozen=True, slots=True)
class Stamps:
    """A frame's stamps: seconds since the server's start, and ticks of its clock. exposure: 0 where unknown."""

    seconds: float
    exposure: int
    received: int
    transmit: int


def message(number: int, payload: bytes) -> bytes:
    """A packet."""
    return MESSAGE.pack(number, len(payload)) + payload


def server_info(name: str, version: Version, clock_hz: int, data_port: int, group: str | None) -> bytes:
    """The answer to CONNECT and DISCOVERY."""
    who = name.encode().ljust(256, b"\0") + bytes((*MOTIVE[version], 0, 0)) + bytes((*version, 0, 0))
    address = bytes(int(part) for part in (group or "0.0.0.0").split("."))
    return message(SERVER_INFO, who + pack("<QHB", clock_hz, data_port, group is not None) + address)


def models(bodies: Mapping[int, str], version: Version) -> bytes:
    """The answer to a request for models: of each body its marker set, then the set of all, then the bodies."""
    markers = range(1, len(OFFSETS_M) + 1)
    sets = {name: [f"Marker{k}" for k in markers] for name in bodies.values()}
    sets[ALL] = [f"{name}_{k}" for name in bodies.values() for k in markers]
    parts = [(0, _text(name) + pack("<i", len(of)) + b"".join(map(_text, of))) for name, of in sets.items()]
    parts += [(1, _body_model(number, name, version)) for number, name in bodies.items()]
    payload = pack("<i", len(parts))
    for kind, content in parts:
        payload += pack("<i", kind) + (pack("<i", len(content)) if version >= (4, 1) else b"") + content
    return message(MODELS, payload)


def _body_model(number: int, name: str, version: Version) -> bytes:
    """Name, id, no parent, no offset (from 4.2: nor rotation); markers: positions, active labels, from 4.0 names."""
    count = len(OFFSETS_M)
    rotation = pack("<4f", 0, 0, 0, 1) if version >= (4, 2) else b""
    names = b"".join(_text(f"Marker{k + 1}") for k in range(count)) if version >= (4, 0) else b""
    markers = pack("<i", count) + OFFSETS_M.astype("<f4").tobytes() + bytes(4 * count) + names
    return _text(name) + pack("<ii3f", number, -1, 0, 0, 0) + rotation + markers


def frame(
    number: int, bodies: NDArray[np.void], names: list[str], stamps: Stamps, params: int, version: Version
) -> bytes:
    """A frame of mocap data; `bodies` of BODY, with the name of each."""
    at_m = _markers_m(bodies)
    sections = (
        (len(names) + 1, _marker_sets(names, at_m)),
        (0, b""),
        (len(bodies), bodies.tobytes()),
        (0, b""),
        *([(0, b"")] if version >= (4, 1) else []),
        (at_m.shape[0] * at_m.shape[1], _markers(bodies, at_m)),
        (0, b""),
        (0, b""),
    )
    counted = version >= (4, 1)
    payload = b"".join(
        pack("<ii", count, len(content)) + content if counted else pack("<i", count) + content
        for count, content in sections
    )
    times = pack("<2Id3Q", 0, 0, stamps.seconds, stamps.exposure, stamps.received, stamps.transmit)
    precise = pack("<2I", 0, 0) if counted else b""
    return message(FRAME, pack("<i", number) + payload + times + precise + pack("<hI", params, 0))


def rows(raw: RawFrame, ids: list[int], unit_m: float) -> NDArray[np.void]:
    """A frame's bodies as BODY. One that is out of sight keeps the pose it is given, and is not marked as tracked."""
    bodies = np.zeros(len(ids), BODY)
    bodies["id"] = ids
    bodies["pos"] = raw.pos_mocap_m / unit_m
    bodies["q_xyzw"] = raw.q_mocap_from_marker[:, [1, 2, 3, 0]]
    bodies["error"] = ERROR_M / unit_m
    bodies["params"] = raw.seen
    return bodies


def _markers_m(bodies: NDArray[np.void]) -> Float:
    """Where every marker is (n, markers, 3)."""
    axis, w = bodies["q_xyzw"][:, None, :3], bodies["q_xyzw"][:, None, 3:]
    across = 2.0 * np.cross(axis, OFFSETS_M)
    return np.asarray(bodies["pos"][:, None, :] + OFFSETS_M + w * across + np.cross(axis, across), dtype="<f4")


def _marker_sets(names: list[str], at_m: Float) -> bytes:
    count = pack("<i", at_m.shape[1])
    each = b"".join(_text(name) + count + points.tobytes() for name, points in zip(names, at_m, strict=True))
    return each + _text(ALL) + pack("<i", at_m.shape[0] * at_m.shape[1]) + at_m.tobytes()


def _markers(bodies: NDArray[np.void], at_m: Float) -> bytes:
    """The labelled markers: the body's id in the upper half of theirs."""
    markers = np.zeros(at_m.shape[:2], MARKER)
    markers["id"] = (bodies["id"][:, None] << 16) + np.arange(1, at_m.shape[1] + 1)
    markers["pos"] = at_m
    markers["size"] = MARKER_SIZE_M
    markers["params"] = np.where(bodies["params"][:, None] & 1, SOLVED, HIDDEN)
    markers["residual"] = ERROR_M
    return markers.tobytes()


def _text(text: str) -> bytes:
    return text.encode()[:255] + b"\0"

"""Vicon's objects as a server writes them. Source: the stream classes published with its DataStream SDK. Pure.

Little endian throughout; a text is its length and its bytes, a set or list its length and its members.
"""

import struct
from collections.abc import Iterable, Sequence

import numpy as np

from formation.messages import RawFrame
from sim.cameras.servers.matrices import matrices

OBJECTS = 0x1A2B0001
STREAM_INFO, SUBJECT_INFO, FRAME_INFO, GLOBAL_SEGMENTS, LATENCY_INFO = 1, 2, 5, 9, 26
APPLICATION_INFO, FRAME_RATE_INFO, PING = 37, 39, 42
OBJECT_ENUMS, REQUEST_FRAME, CONTENTS, REQUEST_NEXT_FRAME = 100001, 100002, 100004, 100008
OFFERED = (
    STREAM_INFO, SUBJECT_INFO, FRAME_INFO, GLOBAL_SEGMENTS, LATENCY_INFO, APPLICATION_INFO, FRAME_RATE_INFO, PING,
    CONTENTS,
)  # fmt: skip
STATIC = (STREAM_INFO, SUBJECT_INFO, APPLICATION_INFO)
"""What is sent only when it has changed."""
TICKS_HZ = 135_000_000
Z_UP = b"\0"
_SEGMENT = np.dtype([("identifier", "<u4"), ("pos_mm", "<f8", 3), ("rotation", "<f8", (3, 3))])

Block = tuple[int, bytes]


def packet(blocks: Iterable[Block]) -> bytes:
    """Header and blocks."""
    body = b"".join(struct.pack("<II", kind, len(data)) + data for kind, data in blocks)
    return struct.pack("<II", OBJECTS, len(body)) + body


def text(words: str) -> bytes:
    """A string."""
    data = words.encode()
    return struct.pack("<I", len(data)) + data


def kinds(members: Iterable[int]) -> bytes:
    """A set of kinds."""
    ordered = sorted(members)
    return struct.pack(f"<{1 + len(ordered)}I", len(ordered), *ordered)


def contents(blocks: Sequence[Block], unchanged: Iterable[int]) -> Block:
    """How many objects of each kind follow, and which kinds are as before."""
    counts: dict[int, int] = dict.fromkeys(unchanged, 0)
    for kind, _ in blocks:
        counts[kind] = counts.get(kind, 0) + 1
    table = b"".join(struct.pack("<II", *item) for item in sorted(counts.items()))
    return CONTENTS, struct.pack("<I", len(counts)) + table + kinds(unchanged)


def static_objects(bodies: Sequence[str], rate_hz: float) -> list[Block]:
    """Frame period, subjects and axes."""
    period = struct.pack("<q", round(TICKS_HZ / rate_hz))
    subjects = [(SUBJECT_INFO, subject(k, name)) for k, name in enumerate(bodies, 1)]
    return [(STREAM_INFO, period), *subjects, (APPLICATION_INFO, Z_UP)]


def subject(identifier: int, name: str) -> bytes:
    """One rigid object: a root segment of its own name, no marker, no attachment."""
    root = struct.pack("<II6f", 0, 1, *([0.0] * 6)) + text(name)
    return struct.pack("<I", identifier) + text(name) + struct.pack("<I", 1) + root + struct.pack("<II", 0, 0)


def dynamic_objects(number: int, rate_hz: float, latencies_s: dict[str, float], frame: RawFrame) -> list[Block]:
    """Frame number, latencies, rate, and each subject's segment: a lost one is not there."""
    samples = b"".join(text(name) + struct.pack("<d", value) for name, value in latencies_s.items())
    rates = struct.pack("<I", 1) + text("Target") + struct.pack("<d", rate_hz)
    return [
        (FRAME_INFO, struct.pack("<I", number & 0xFFFFFFFF)),
        (LATENCY_INFO, struct.pack("<I", len(latencies_s)) + samples),
        (FRAME_RATE_INFO, rates),
        *global_segments(frame),
    ]


def global_segments(frame: RawFrame) -> list[Block]:
    """Millimetres and matrices, rows first."""
    roots = np.empty(len(frame.bodies), _SEGMENT)
    roots["identifier"] = 1
    roots["pos_mm"] = 1000.0 * frame.pos_mocap_m
    roots["rotation"] = matrices(frame.q_mocap_from_marker)
    data, size = roots.tobytes(), _SEGMENT.itemsize
    return [
        (GLOBAL_SEGMENTS, struct.pack("<II", k, seen) + data[(k - 1) * size : (k - 1 + seen) * size])
        for k, seen in enumerate(frame.seen.astype(int).tolist(), 1)
    ]

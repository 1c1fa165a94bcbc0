"""Frames are found in any cut of any stream, and pass unchanged."""

from itertools import pairwise

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from wire.link_messages.address import Address
from wire.link_messages.motion import LocalPosition
from wire.link_messages.status import StatusText
from wire.mavlink import Codec
from wire.mavlink_frames import FrameCutter, message_id

CODEC = Codec(Address(1, 1))
FRAMES = [
    CODEC.encode(LocalPosition(5, np.array([1.0, 2.0, 3.0]), np.zeros(3))),
    CODEC.encode(StatusText(6, "hello")),
    mavlink.MAVLink(None, 3, 1).heartbeat_encode(2, 12, 0, 0, 3).pack(mavlink.MAVLink(None, 3, 1), force_mavlink1=True),
]


@given(st.lists(st.sampled_from(FRAMES), max_size=8), st.lists(st.integers(0, 400), max_size=12))
def test_every_cut_of_a_stream_gives_its_frames(frames: list[bytes], cuts: list[int]) -> None:
    stream = b"".join(frames)
    edges = [0, *sorted(min(c, len(stream)) for c in cuts), len(stream)]
    cutter = FrameCutter()
    found = [frame for a, b in pairwise(edges) for frame in cutter.cut(stream[a:b])]
    assert found == frames
    assert cutter.dropped_bytes == 0


@given(st.binary(max_size=600), st.lists(st.integers(0, 600), max_size=6))
def test_any_bytes_are_survived_and_counted(data: bytes, cuts: list[int]) -> None:
    edges = [0, *sorted(min(c, len(data)) for c in cuts), len(data)]
    cutter = FrameCutter()
    found = [frame for a, b in pairwise(edges) for frame in cutter.cut(data[a:b])]
    assert sum(map(len, found)) + cutter.dropped_bytes <= len(data)


def test_a_damaged_frame_costs_only_itself() -> None:
    damaged = bytearray(FRAMES[0])
    damaged[12] ^= 0x40
    cutter = FrameCutter()
    assert cutter.cut(bytes(damaged) + FRAMES[1] + FRAMES[2]) == FRAMES[1:]
    assert cutter.dropped_bytes == len(damaged)


def test_the_message_is_known_by_its_number() -> None:
    assert [message_id(frame) for frame in FRAMES] == [32, 253, 0]

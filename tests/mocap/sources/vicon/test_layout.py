"""A packet laid out as the one before is read the same as one taken apart, whichever of its bytes is another."""

import dataclasses
import struct

import numpy as np
import pytest

from formation.messages import RawFrame
from formation.mocap_config import ViconConfig
from mocap.sources.vicon import packets
from mocap.sources.vicon.packets import Kind, packet_of
from mocap.sources.vicon.session import Vicon
from tests.mocap.sources.recorded_feed import kept
from tests.mocap.sources.vicon_bytes import FIRST, OFFER

MS_NS = 1_000_000


class Client:
    """Reads packets, one a millisecond; by the layout of the last, or each on its own."""

    def __init__(self, by_layout: bool) -> None:
        self.record = kept("vicon")
        self._by_layout = by_layout
        self._source = Vicon(ViconConfig(), ("lead", "right"), 8 * MS_NS, self.record.feed())
        self._session, _ = self._source.open(0, "", "")
        self._now_ns = 0
        for data in (OFFER, FIRST):
            self.read(data)

    def read(self, data: bytes) -> tuple[object, ...]:
        """What came of it: of the frame all numbers, and what was refused."""
        self._now_ns += MS_NS
        self.record.frames.clear()
        if not self._by_layout:
            self._session._layout = None
        self._session.received(data, self._now_ns)
        return *map(values_of, self.record.frames), *self.record.refused()


def values_of(frame: RawFrame) -> list[object]:
    values = (getattr(frame, field.name) for field in dataclasses.fields(frame))
    return [value.tobytes() if isinstance(value, np.ndarray) else value for value in values]


def segments(subject: int, *roots: int) -> packets.Block:
    cells = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]
    segments_bytes = (packets.SEGMENT.pack(root, 10.0 * root, subject, 3.0, *cells) for root in roots)
    return Kind.GLOBAL_SEGMENTS, struct.pack("<II", subject, len(roots)) + b"".join(segments_bytes)


def packet(number: int, *blocks: packets.Block) -> bytes:
    latency = struct.pack("<II1sd", 1, 1, b"a", 1e-3 * (1 + number % 2))
    return packet_of((Kind.FRAME_INFO, struct.pack("<I", number)), (Kind.LATENCY_INFO, latency), *blocks)


@pytest.mark.parametrize(
    "blocks",
    [
        (segments(7, 2, 3), segments(8, 1)),
        (segments(7, 3), segments(7, 3), segments(8, 1, 1)),
    ],
)
def test_every_byte_of_a_packet_may_be_another(blocks: tuple[packets.Block, ...]) -> None:
    first, second = Client(by_layout=True), Client(by_layout=False)
    number = 5000
    for at in range(8, len(packet(0, *blocks))):
        for data in (packet(number, *blocks), packet(number + 1, *blocks), bytearray(packet(number + 2, *blocks))):
            if isinstance(data, bytearray):
                data[at] ^= 1 << at % 8
            assert first.read(bytes(data)) == second.read(bytes(data)), at
            number += 1


def test_poses_unchanged_since_a_packet_read_by_its_layout_are_that_ones() -> None:
    client = Client(by_layout=True)
    for number in range(5000, 5004):
        client.read(packet(number, segments(7, 2, 3), segments(8, 1)))
    contents = struct.pack("<III", 0, 1, Kind.GLOBAL_SEGMENTS)
    client.read(packet(5004, (Kind.CONTENTS, contents)))
    (frame,) = client.record.frames
    np.testing.assert_allclose(frame.pos_mocap_m, [[0.03, 0.007, 0.003], [0.01, 0.008, 0.003]])
    assert frame.seen.tolist() == [True, True]

"""Vicon's objects, against bytes that the classes of Vicon's own DataStream SDK 1.12 wrote."""

import struct

import numpy as np
import pytest

from formation.mocap_config import ViconConfig
from mocap.sources import vicon as packets
from mocap.sources.tcp import ProtocolError
from mocap.sources.vicon import Kind, Stream, Vicon, packet_of
from tests.mocap.sources.recorded_feed import kept
from tests.mocap.sources.vicon_bytes import FIRST, OFFER


@pytest.mark.parametrize(
    ("data", "why"),
    [
        (b"GET / HTTP/1.1\r\n", "not that of a packet of objects"),
        (struct.pack("<II", packets.STREAM_TAG, 2**31), "a length that no packet has"),
    ],
)
def test_what_is_no_stream(data, why):
    with pytest.raises(ProtocolError, match=why):
        Stream().receive(data)


@pytest.mark.parametrize(
    ("read", "data", "why"),
    [
        (packets.blocks_of, b"\1\0\0\0", "block header: cut short"),
        (packets.blocks_of, struct.pack("<II", 1, 9), "block header: a length beyond the packet"),
        (packets.blocks_of, bytes(8 * 4001), "packet: more blocks than any packet has"),
        (packets.kinds_of, struct.pack("<II", 2**32 - 1, 1), "ObjectEnums: a count beyond the block"),
        (packets.unchanged_of, struct.pack("<III", 2**32 - 1, 1, 1), "Contents: a count beyond the block"),
        (packets.number_of, b"\1\0", "FrameInfo: cut short"),
        (packets.period_of, bytes(7), "StreamInfo: cut short"),
        (packets.period_of, struct.pack("<q", -1), "StreamInfo: a frame period that no camera has"),
        (packets.subject_of, struct.pack("<II", 1, 2**32 - 1), "SubjectInfo: a text beyond the block"),
        (packets.subject_of, struct.pack("<III", 1, 0, 0), "SubjectInfo: a subject without a segment"),
        (packets.subject_of, struct.pack("<III", 1, 0, 1), "SubjectInfo: cut short"),
        (packets.latency_of, struct.pack("<I", 2**32 - 1), "LatencyInfo: cut short"),
        (packets.latency_of, struct.pack("<IId", 1, 0, 3.0), "LatencyInfo: not between 0 and 1 s"),
        (lambda data: packets.root_of(data, {}), struct.pack("<II", 1, 2**31), "count and length do not agree"),
    ],
)
def test_what_cannot_be_read_is_named(read, data, why):
    with pytest.raises(ValueError, match=why):
        read(data)


MS_NS = 1_000_000


class Client:
    """Reads packets, one a millisecond."""

    def __init__(self) -> None:
        self.record = kept("vicon")
        self._source = Vicon(ViconConfig(), ("lead", "right"), 8 * MS_NS, self.record.feed())
        self._session, _ = self._source.open(0, "", "")
        self._now_ns = 0
        for data in (OFFER, FIRST):
            self.read(data)

    def read(self, data: bytes) -> None:
        self._now_ns += MS_NS
        self.record.frames.clear()
        self._session.received(data, self._now_ns)


def segments(subject: int, *roots: int) -> packets.Block:
    cells = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]
    segments_bytes = (packets.SEGMENT.pack(root, 10.0 * root, subject, 3.0, *cells) for root in roots)
    return Kind.GLOBAL_SEGMENTS, struct.pack("<II", subject, len(roots)) + b"".join(segments_bytes)


def packet(number: int, *blocks: packets.Block) -> bytes:
    latency = struct.pack("<II1sd", 1, 1, b"a", 1e-3 * (1 + number % 2))
    return packet_of((Kind.FRAME_INFO, struct.pack("<I", number)), (Kind.LATENCY_INFO, latency), *blocks)


def test_poses_that_contents_calls_unchanged_are_those_of_the_packet_before() -> None:
    client = Client()
    for number in range(5000, 5004):
        client.read(packet(number, segments(7, 2, 3), segments(8, 1)))
    contents = struct.pack("<III", 0, 1, Kind.GLOBAL_SEGMENTS)
    client.read(packet(5004, (Kind.CONTENTS, contents)))
    (frame,) = client.record.frames
    np.testing.assert_allclose(frame.pos_mocap_m, [[0.03, 0.007, 0.003], [0.01, 0.008, 0.003]])
    assert frame.seen.tolist() == [True, True]

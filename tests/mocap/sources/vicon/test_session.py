"""A connection to a DataStream server, bytes by their own classes; time by hand."""

import struct

import numpy as np
import pytest

from formation.mocap_config import ViconConfig
from mocap.sources import vicon as packets
from mocap.sources.tcp import ProtocolError
from mocap.sources.vicon import Kind, Vicon, ViconSession, packet_of
from tests.mocap.sources.recorded_feed import Kept, kept
from tests.mocap.sources.vicon_bytes import FIRST, OFFER, PING, STREAM, UNCHANGED, WANT

S_NS = 1_000_000_000


def source_of(record: Kept) -> Vicon:
    return Vicon(ViconConfig(), ("lead", "right"), 8_000_000, record.feed())


def opened(record: Kept) -> tuple[Vicon, ViconSession]:
    source = source_of(record)
    session, hello = source.open(0, "", "")
    assert hello == b""
    assert session.received(OFFER, 0) == WANT + STREAM
    return source, session


def test_a_frame_of_theirs():
    record = kept("vicon")
    source, session = opened(record)
    assert session.received(FIRST, 10 * S_NS) == b""
    (frame,) = record.frames
    assert frame.bodies == ("lead", "right")
    assert frame.seen.tolist() == [True, False]
    np.testing.assert_allclose(frame.pos_mocap_m[0], [1.00025, -0.2505, 1.5], atol=1e-12)
    np.testing.assert_allclose(frame.q_mocap_from_marker[0], [np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)], atol=1e-12)
    assert frame.t_capture_ns == 10 * S_NS - 4_000_000  # the latency it reports
    status = source.status()
    assert status.latency_measured
    assert status.latency_s == pytest.approx(0.004)
    assert status.bodies == ("lead", "right")
    assert record.texts() == ["the server names lead, right"]


def test_what_is_unchanged_is_what_it_was():
    record = kept("vicon")
    _, session = opened(record)
    session.received(FIRST, 10 * S_NS)
    session.received(UNCHANGED, 10 * S_NS + 30_000_000)
    first, second = record.frames
    np.testing.assert_array_equal(second.pos_mocap_m, first.pos_mocap_m)
    assert second.seen.tolist() == [True, False]
    # 3 frame periods later by the numbers, 1 ms less by the arrival: the number is believed, never the future
    assert second.t_capture_ns == first.t_capture_ns + 30_000_000
    session.received(UNCHANGED, 10 * S_NS + 31_000_000)
    assert len(record.frames) == 2
    assert record.refused() == ["refused: 1 x a frame whose number came already"]
    zero = struct.pack("<II", 7, 1) + packets.SEGMENT.pack(3, *[0.0] * 12)
    session.received(frame_packet(4715, (Kind.GLOBAL_SEGMENTS, zero)), 10 * S_NS + 40_000_000)
    assert not record.frames[-1].seen.any()


def test_without_a_frame_period_a_frame_has_no_stamp():
    record = kept("vicon")
    _, session = opened(record)
    session.received(frame_packet(1), S_NS)
    assert record.frames[0].t_capture_ns == 0


def test_a_latency_that_is_none_leaves_the_last_one():
    record = kept("vicon")
    _, session = opened(record)
    session.received(FIRST, 10 * S_NS)
    wrong = struct.pack("<IId", 1, 0, float("inf"))
    session.received(frame_packet(4712, (Kind.LATENCY_INFO, wrong)), 10 * S_NS + 10_000_000)
    assert record.refused() == ["refused: 1 x LatencyInfo: not between 0 and 1 s"]
    session.received(frame_packet(4713), 10 * S_NS + 20_000_000)
    assert [f.t_capture_ns - 10 * S_NS for f in record.frames] == [-4_000_000, 6_000_000, 16_000_000]


def test_bad_packets_are_counted_and_the_next_is_read():
    record = kept("vicon")
    _, session = opened(record)
    session.received(FIRST, 0)
    stranger = (Kind.GLOBAL_SEGMENTS, struct.pack("<II", 99, 0))
    for number, block in enumerate(
        [stranger, (Kind.GLOBAL_SEGMENTS, b"\7"), (Kind.GLOBAL_SEGMENTS, struct.pack("<II", 7, 2**32 - 1))], 4712
    ):
        session.received(frame_packet(number, block), 10_000_000)
    assert record.refused() == [
        "refused: 1 x GlobalSegments: a subject that is not named, 1 x GlobalSegments: cut short, "
        "1 x GlobalSegments: count and length do not agree"
    ]
    session.received(frame_packet(4716), 50_000_000)
    assert [frame.seq for frame in record.frames] == [0, 1, 2, 3, 5]


def test_a_paused_server_is_pinged_each_second_and_one_without_poses_or_words_is_left():
    record = kept("vicon")
    _, session = opened(record)
    assert [session.due(t_ns) for t_ns in (S_NS // 2, S_NS, S_NS + 1)] == [b"", PING, b""]
    session, _ = source_of(record).open(0, "", "")
    with pytest.raises(ProtocolError, match="no segments"):
        session.received(packet_of((Kind.OBJECT_ENUMS, packets.set_of({1, 2, 5}))), 0)
    session, _ = source_of(record).open(0, "", "")
    assert session.due(2 * S_NS) == b""
    with pytest.raises(ProtocolError, match="no list of what is offered"):
        session.due(2 * S_NS + 1)


def frame_packet(number: int, *others: packets.Block) -> bytes:
    return packet_of((Kind.FRAME_INFO, struct.pack("<I", number)), *others)

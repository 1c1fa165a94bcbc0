"""Packets out of a byte stream cut anywhere, and long texts out of chunks."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as oracle

from formation.messages import Severity
from tests.wire.messages import ANY_MESSAGE, assert_same, text
from wire.link_messages.address import GROUND, Address
from wire.link_messages.status import Heartbeat, MavAutopilot, StatusText
from wire.mavlink.codec import Codec

DRONE, OTHER = Address(7, 1), Address(8, 1)
HEARTBEAT = Heartbeat(MavAutopilot.PX4, 2, 0, 0, 4)
LONG = "Preflight Fail: " + "heading estimate not stable, " * 12


def for_everybody(message) -> bool:
    return not hasattr(message, "target") and not hasattr(message, "target_system")


@given(st.lists(ANY_MESSAGE.filter(for_everybody), max_size=6), st.data())
def test_a_stream_reads_the_same_however_it_is_cut(messages, data):
    drone = Codec(DRONE)
    stream = b"".join(drone.encode(message) for message in messages)
    cuts = sorted(data.draw(st.lists(st.integers(0, len(stream)), max_size=8)))
    codec = Codec(GROUND, stream=True)
    packets = []
    for start, end in zip([0, *cuts], [*cuts, len(stream)], strict=True):
        packets += codec.receive(stream[start:end])
    assert len(packets) == len(messages)
    for message, packet in zip(messages, packets, strict=True):
        assert_same(message, packet.message)
    assert (codec.bad_bytes, codec.bad_packets) == (0, 0)


def test_a_stream_reads_byte_by_byte():
    codec = Codec(GROUND, stream=True)
    frame = Codec(DRONE).encode(HEARTBEAT)
    packets = [packet for byte in frame for packet in codec.receive(bytes([byte]))]
    assert [packet.message for packet in packets] == [HEARTBEAT]


@given(st.binary(max_size=40), st.binary(max_size=40))
def test_noise_on_a_serial_line_costs_at_most_what_it_hides(before, between):
    """Noise that looks like a head delays what follows by the longest packet, 280 bytes; then all is found again."""
    drone = Codec(DRONE)
    codec = Codec(GROUND, stream=True)
    packets = codec.receive(before + drone.encode(HEARTBEAT) + between)
    packets += codec.receive(b"".join(drone.encode(HEARTBEAT) for _ in range(40)))
    beats = [packet.seq for packet in packets if packet.message == HEARTBEAT]
    assert len(beats) >= 40 - 2 * 14
    assert beats == sorted(set(beats))


def test_a_corrupted_packet_does_not_take_the_next_one_with_it():
    drone = Codec(DRONE)
    bad = bytearray(drone.encode(HEARTBEAT))
    bad[15] ^= 0xFF
    codec = Codec(GROUND)
    (packet,) = codec.receive(bytes(bad) + drone.encode(HEARTBEAT))
    assert packet.seq == 1
    assert (codec.bad_packets, codec.bad_bytes) == (1, len(bad))


def test_an_unfinished_packet_at_the_end_of_a_datagram_is_lost_not_waited_for():
    drone = Codec(DRONE)
    codec = Codec(GROUND)
    assert codec.receive(drone.encode(HEARTBEAT)[:12]) == []
    assert codec.bad_bytes == 12
    assert len(codec.receive(drone.encode(HEARTBEAT))) == 1


def test_several_packets_in_a_datagram():
    drone = Codec(DRONE)
    datagram = b"".join(drone.encode(HEARTBEAT) for _ in range(5))
    assert [packet.seq for packet in Codec(GROUND).receive(datagram)] == [0, 1, 2, 3, 4]


def packets_of(data: bytes) -> list[bytes]:
    """The datagram cut into its packets."""
    cut = []
    while data:
        length = 12 + data[1]
        cut.append(data[:length])
        data = data[length:]
    return cut


@given(st.integers(1, 300))
def test_a_text_of_any_length_arrives_whole(length):
    message = StatusText(Severity.WARNING, "x" * length)
    (packet,) = Codec(GROUND).receive(Codec(DRONE).encode(message))
    assert packet.message == message


@pytest.mark.parametrize(("length", "count"), [(0, 1), (49, 1), (50, 1), (51, 2), (99, 2), (100, 3), (101, 3)])
def test_a_text_whose_chunks_are_all_full_is_ended_by_an_empty_one(length, count):
    data = Codec(DRONE).encode(StatusText(Severity.INFO, "x" * length))
    assert len(packets_of(data)) == count


def test_chunks_carry_one_id_and_their_place():
    codec = Codec(DRONE)
    codec.encode(StatusText(Severity.INFO, LONG))
    mav = oracle.MAVLink(None)
    mav.robust_parsing = False
    chunks = mav.parse_buffer(codec.encode(StatusText(Severity.INFO, LONG)))
    assert {chunk.id for chunk in chunks} == {2}
    assert [chunk.chunk_seq for chunk in chunks] == list(range(len(chunks)))
    assert "".join(chunk.text for chunk in chunks) == LONG


@given(text(50), text(200), text(200))
def test_chunks_of_two_drones_do_not_mix(short, one, two):
    first, second = Codec(DRONE), Codec(OTHER)
    a = packets_of(first.encode(StatusText(Severity.INFO, one)))
    b = packets_of(second.encode(StatusText(Severity.ERROR, two)))
    mixed = [packet for pair in zip(a, b, strict=False) for packet in pair]
    mixed += a[len(b) :] + b[len(a) :]
    codec = Codec(GROUND)
    texts = {packet.source: packet.message.text for data in mixed for packet in codec.receive(data)}
    assert texts == {DRONE: one, OTHER: two}


def test_a_lost_chunk_shows_as_an_ellipsis_and_the_next_text_is_whole():
    drone = Codec(DRONE)
    first, _, third, *rest = packets_of(drone.encode(StatusText(Severity.ERROR, LONG)))
    after = drone.encode(StatusText(Severity.INFO, "Ready"))
    codec = Codec(GROUND)
    texts = [p.message.text for data in (first, third, *rest, after) for p in codec.receive(data)]
    assert texts == [LONG[:50] + "…", "…" + LONG[100:], "Ready"]


def test_many_senders_of_unfinished_texts_are_not_kept_for_ever():
    codec = Codec(GROUND)
    texts = []
    for system in range(1, 201):
        first, *_ = packets_of(Codec(Address(system, 1)).encode(StatusText(Severity.INFO, LONG)))
        texts += codec.receive(first)
    assert len(texts) == 200 - 64


def test_a_text_cut_inside_a_character_is_joined_before_it_is_read():
    message = StatusText(Severity.INFO, "x" * 49 + "ü" * 40)
    (packet,) = Codec(GROUND).receive(Codec(DRONE).encode(message))
    assert packet.message == message

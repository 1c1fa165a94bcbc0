"""Packets out of a byte stream cut anywhere, and long texts out of chunks."""

import pytest
from hypothesis import given
from pymavlink.dialects.v20 import ardupilotmega as oracle

from formation.messages import Severity
from tests.wire.messages import text
from wire.link_messages import GROUND, Address, StatusText
from wire.mavlink.codec import Codec

DRONE, OTHER = Address(7, 1), Address(8, 1)
LONG = "Preflight Fail: " + "heading estimate not stable, " * 12


def packets_of(data: bytes) -> list[bytes]:
    """The datagram cut into its packets."""
    cut = []
    while data:
        length = 12 + data[1]
        cut.append(data[:length])
        data = data[length:]
    return cut


@pytest.mark.parametrize(("length", "count"), [(0, 1), (50, 1), (51, 2), (99, 2), (100, 3)])
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

"""Payload layouts from pymavlink's tables; frames are found in any cut of any stream, and pass unchanged."""

import struct
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from wire.link_messages import Address, LocalPosition, StatusText
from wire.mavlink import framing
from wire.mavlink.codec import Codec, read_message
from wire.mavlink.framing import FRAMES_MOST, FrameCutter, frame_count, layout, packed


def test_fields_go_in_by_documentation_and_out_by_size():
    heartbeat = layout("HEARTBEAT", 6)
    assert heartbeat.payload.format == "<IBBBBB"
    assert heartbeat.pack((2, 12, 81, 0x01020304, 4, 3)) == bytes([4, 3, 2, 1, 2, 12, 81, 4, 3])
    assert heartbeat.unpack(bytes([4, 3, 2, 1, 2, 12, 81, 4, 3])) == (2, 12, 81, 0x01020304, 4, 3)


def test_trailing_zeros_are_cut_but_for_one_byte():
    ping = layout("PING", 4)
    assert ping.pack((1, 0, 0, 0)) == b"\1"
    assert ping.pack((0, 0, 0, 0)) == b"\0"
    assert ping.unpack(b"\1") == (1, 0, 0, 0)


def test_what_a_newer_dialect_appends_is_cut():
    assert layout("HEARTBEAT", 6).unpack(bytes(9) + b"more") == (0,) * 6
    battery = layout("BATTERY_STATUS", 18)  # without its extensions, MAVLink 1's message
    assert battery.payload.size == 36
    assert battery.pack(tuple(range(1, 19))) == layout("BATTERY_STATUS", 26).pack((*range(1, 19), *[0] * 8))


@pytest.mark.parametrize("known", [0, 1, 2])
def test_extensions_are_the_same_bytes_whether_pymavlink_knows_them_or_not(known, monkeypatch):
    """TIMESYNC got a target; pymavlink has it in some versions and not in others."""
    message = SimpleNamespace(
        id=111, crc_extra=34, unpacker=struct.Struct("<qq" + "B" * known), orders=list(range(2 + known))
    )
    monkeypatch.setattr(framing.dialect, "MAVLink_timesync_message", message)
    timesync = layout("TIMESYNC", 4, extension="BB")
    assert timesync.pack((1, 2, 3, 4)) == struct.pack("<qqBB", 1, 2, 3, 4)
    assert timesync.unpack(struct.pack("<qqBB", 1, 2, 3, 4)) == (1, 2, 3, 4)


@pytest.mark.parametrize(("name", "count"), [("PING", 5), ("SET_ATTITUDE_TARGET", 6), ("BATTERY_STATUS", 10)])
def test_fields_that_cannot_be_had_are_refused(name, count):
    with pytest.raises(ValueError, match=name):
        layout(name, count)


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
    cutter = FrameCutter(stream=True)
    found = [frame.data for a, b in pairwise(edges) for frame in cutter.cut(stream[a:b])]
    assert found == frames
    assert cutter.dropped_bytes == 0


@given(st.lists(st.sampled_from(FRAMES), max_size=8), st.integers(0, 400))
def test_as_many_frames_are_counted_as_are_cut(frames: list[bytes], end: int) -> None:
    datagram = b"".join(frames)[:end]
    assert frame_count(datagram) == len(FrameCutter().cut(datagram))


def test_a_frame_is_read_once_by_whoever_has_it() -> None:
    (frame,) = FrameCutter().cut(FRAMES[0])
    (packet,) = Codec(Address(1, 1)).read([frame])
    assert read_message(frame) is packet.message


def test_a_damaged_frame_costs_only_itself() -> None:
    damaged = bytearray(FRAMES[0])
    damaged[12] ^= 0x40
    cutter = FrameCutter()
    assert [frame.data for frame in cutter.cut(bytes(damaged) + FRAMES[1] + FRAMES[2])] == FRAMES[1:]
    assert cutter.dropped_bytes == len(damaged)


# What made a parser that begins again behind every byte cost 1.5 to 377 ms of CPU a datagram.
PADDINGS = {
    "all 0xFE": b"\xfe", "all 0xFD": b"\xfd", "0xFE 0xFD": b"\xfe\xfd", "shortest": b"\xfe\x00",
    "longest": b"\xfe\xff", "signed heads": b"\xfd\x00\x01", "refused flags": b"\xfd\xff\x02",
    "heads in heads": b"\xfd\x10\x00\xfe\x05\x00", "wrong checksums": b"\xfe\x00\x00\x01\x01\x00\xaa\xaa",
}  # fmt: skip


@pytest.mark.parametrize("padding", PADDINGS.values(), ids=PADDINGS)
def test_no_datagram_is_searched_more_than_a_few_times(padding: bytes) -> None:
    cutter = FrameCutter()
    assert cutter.cut((padding * 2048)[:2048]) == []
    assert cutter.bad_frames <= 8
    assert cutter.dropped_bytes == 2048
    assert [frame.data for frame in cutter.cut(FRAMES[0])] == [FRAMES[0]]


@pytest.mark.parametrize("padding", PADDINGS.values(), ids=PADDINGS)
def test_a_line_is_searched_in_proportion_to_its_bytes_and_found_again(padding: bytes) -> None:
    cutter = FrameCutter(stream=True)
    for _ in range(16):
        cutter.cut((padding * 4096)[:4096])
    assert cutter.bad_frames <= 16 * (8 + (4096 + 280) // 32)
    frames = [frame for _ in range(40) for frame in cutter.cut(FRAMES[0])]
    assert frames[-1].data == FRAMES[0]
    assert len(frames) >= 40 - 280 // len(FRAMES[0]) - 1


def test_a_datagram_that_is_too_large_or_too_full_is_not_read_to_its_end() -> None:
    cutter = FrameCutter()
    assert cutter.cut(FRAMES[0] + bytes(2048)) == []
    assert cutter.dropped_bytes == len(FRAMES[0]) + 2048
    assert len(cutter.cut(FRAMES[2] * 40)) == FRAMES_MOST
    assert len(cutter.cut(FRAMES[2])) == 1


@given(st.lists(st.sampled_from(FRAMES), max_size=80))
def test_packed_frames_are_all_found_again(frames: list[bytes]) -> None:
    datagrams = packed(b"".join(frames))
    assert all(0 < len(datagram) <= 1200 for datagram in datagrams)
    assert [frame.data for datagram in datagrams for frame in FrameCutter().cut(datagram)] == frames

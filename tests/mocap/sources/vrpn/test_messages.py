"""The wire format against what the VRPN library sends, and against what nothing should send."""

import pytest

from mocap.sources.tcp import ProtocolError
from mocap.sources.vrpn import messages
from mocap.sources.vrpn.messages import Message, Stream
from tests.mocap.sources.vrpn import bytes as vrpn_bytes

IDENTITY = bytes(4) * 2 + bytes(8) * 6 + bytes.fromhex("3ff0000000000000")


def test_the_librarys_messages_are_read():
    stream = Stream()
    read = list(stream.messages(vrpn_bytes.SERVER_SAYS[24:] + vrpn_bytes.POSE_OF_LEADER))
    assert [(m.sender, m.type) for m in read] == [(0, -1), (1, -1), (4, -2), (16, -2), (1, 4)]
    assert [messages.described(m.payload) for m in read[:4]] == [
        b"VRPN Control",
        b"leader",
        b"vrpn_Tracker Pos_Quat",
        b"vrpn_Base ping_message",
    ]
    assert read[4] == Message(vrpn_bytes.POSE_STAMP_NS, 1, 4, IDENTITY)
    assert not stream.is_cut
    whole, bytewise = vrpn_bytes.SERVER_SAYS[24:], Stream()
    assert [m for byte in whole for m in bytewise.messages(bytes([byte]))] == read[:4]


def test_messages_are_written_as_the_library_writes_them():
    def without_sequence(data: bytes) -> bytes:
        return data[:20] + bytes(4) + data[24:]

    stamp_ns = 1_795_348_379_740_932_000
    control = messages.message(stamp_ns, 0, -1, bytes.fromhex("0000000d") + b"VRPN Control\0")
    assert control == vrpn_bytes.CONTROL_IS_0
    assert messages.description(-1, 1, b"leader")[12:] == without_sequence(vrpn_bytes.LEADER_IS_1)[12:]
    assert messages.description(-2, 4, b"vrpn_Tracker Pos_Quat")[12:] == without_sequence(vrpn_bytes.POSE_IS_4)[12:]
    pose = messages.message(vrpn_bytes.POSE_STAMP_NS, 1, 4, messages.POSE.pack(0, 0, 0, 0, 0, 0, 0, 0, 1))
    assert pose == without_sequence(vrpn_bytes.POSE_OF_LEADER)
    assert len(messages.COOKIE) == len(vrpn_bytes.COOKIE)
    assert messages.COOKIE.replace(b"07.35", b"07.38") == vrpn_bytes.COOKIE


def test_an_address_for_datagrams_is_a_message_whose_sender_is_the_port():
    (read,) = Stream().messages(messages.udp_description("10.0.0.7", 40_000))
    assert read[1:] == (40_000, -3, b"10.0.0.7\0")


def test_any_minor_version_is_taken_and_no_other_major_one():
    messages.check_cookie(vrpn_bytes.COOKIE)
    messages.check_cookie(b"vrpn: ver. 07.30  0".ljust(24, b"\0"))
    with pytest.raises(ProtocolError, match="version is not 07"):
        messages.check_cookie(b"vrpn: ver. 08.00  0".ljust(24, b"\0"))
    with pytest.raises(ProtocolError, match="not VRPN's"):
        messages.check_cookie(b"HTTP/1.1 400 Bad Request")


@pytest.mark.parametrize("length", [23, 24 + 64_001, 2**32 - 1])
def test_a_length_that_cannot_be_right_ends_the_reading(length: int):
    with pytest.raises(ProtocolError, match="length"):
        list(Stream().messages(length.to_bytes(4, "big") + vrpn_bytes.POSE_OF_LEADER[4:]))


@pytest.mark.parametrize("payload", [bytes(3), bytes(4), b"\0\0\0\x09leader\0"])
def test_a_description_of_another_length_than_its_name_is_rejected(payload: bytes):
    with pytest.raises(ProtocolError, match="description"):
        messages.described(payload)

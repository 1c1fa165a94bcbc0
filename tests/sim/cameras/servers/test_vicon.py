"""The emulated DataStream server's objects, against bytes that Vicon's own classes wrote for the same content."""

import struct

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from formation.messages import RawFrame
from sim.cameras.servers import vicon as objects
from sim.cameras.servers.vicon import ViconConversation

OFFER = bytes.fromhex(
    "01002b1a28000000a18601002000000007000000010000000200000005000000090000001a0000002a000000a4860100"
)
STREAM = bytes.fromhex("01002b1a09000000a28601000100000001")
WANT = bytes.fromhex("01002b1a24000000a18601001c00000006000000010000000200000005000000090000001a000000a4860100")
PING = bytes.fromhex("01002b1a100000002a000000080000000100000000000000")
RIGHT = bytes.fromhex(
    "0800000005000000726967687401000000000000000100000000000000000000000000000000000000000000000000000005000000"
    "72696768740000000000000000"
)
UNCHANGED = bytes.fromhex(
    "0500000001000000000000000200000000000000050000000100000009000000000000001a000000000000000400000001000000"
    "02000000090000001a000000"
)
"""Subject 8, `right`, of one segment; and Contents of a packet that has a frame number alone."""
LATENCY = bytes.fromhex("02000000080000004578706f73757265fa7e6abc7493583f0a00000050726f63657373696e677b14ae47e17a643f")


def a_frame(seen: tuple[bool, bool] = (True, True)) -> RawFrame:
    q = Rotation.from_rotvec([[0.0, 0.0, np.pi / 2], [0.0, 0.0, 0.0]]).as_quat(scalar_first=True)
    return RawFrame(0, 0, ("lead", "right"), np.array([[1.00025, -0.2505, 1.5], [1, 2, 3]]), q, np.array(seen))


def test_objects_are_theirs_byte_by_byte():
    assert objects.packet([(objects.OBJECT_ENUMS, objects.kinds((1, 2, 5, 9, 26, 42, 100004)))]) == OFFER
    assert objects.subject(8, "right") == RIGHT
    assert objects.contents([(5, b"")], (1, 2, 9, 26)) == (objects.CONTENTS, UNCHANGED)
    dynamic = dict(objects.dynamic_objects(4711, 100.0, {"Exposure": 0.0015, "Processing": 0.0025}, a_frame()))
    assert dynamic[objects.FRAME_INFO] == struct.pack("<I", 4711)
    assert dynamic[objects.LATENCY_INFO] == LATENCY
    assert dict(objects.static_objects((), 100.0))[objects.STREAM_INFO] == struct.pack("<q", 1_350_000)


def test_a_client_that_wants_frames_pushed():
    client = ViconConversation()
    assert client.received(WANT + STREAM) == b""
    assert client.wanted == {1, 2, 5, 9, 26, 100004}
    assert client.streaming
    assert client.received(PING) == PING


def test_a_client_that_asks_for_each():
    client = ViconConversation()
    client.received(STREAM[:-1] + b"\0")
    assert (client.streaming, client.requested) == (False, 1)
    client.received(objects.packet([(objects.REQUEST_NEXT_FRAME, struct.pack("<I", 1))]))
    assert client.requested == 2


@pytest.mark.parametrize(
    ("data", "why"),
    [
        (b"GET / HTTP/1.1\r\n", "not a packet of objects"),
        (struct.pack("<II", objects.OBJECTS, 2**31), "not a packet of objects"),
        (objects.packet([(objects.OBJECT_ENUMS, struct.pack("<I", 2**32 - 1))]), "a set longer than its object"),
        (struct.pack("<II", objects.OBJECTS, 3) + b"\1\2\3", "an object cut short"),
    ],
)
def test_what_is_no_packet_ends_the_connection(data, why):
    with pytest.raises(ValueError, match=why):
        ViconConversation().received(data)

import math
from struct import calcsize, pack, unpack_from

import numpy as np
import pytest

from formation.messages import RawFrame
from formation.mocap_config import MocapConfig
from sim.cameras.servers.natnet import CLIENT_NS, OFFSETS_M, NatNetSettings, Responder, natnet_server
from wire.clock import REAL_TIME

S = 10**9
CLIENT, OTHER = ("10.0.0.2", 4000), ("10.0.0.3", 4000)
CONNECT, MODELS, ALIVE, BYE = (pack("<HH", kind, 0) for kind in (0, 4, 10, 9))
VERSIONS = [(3, 0), (3, 1), (4, 0), (4, 1), (4, 2)]
HALF = math.sqrt(0.5)


def raw(bodies=("lead", "left"), seq=1, t_ns=10 * S, seen=None) -> RawFrame:
    n = len(bodies)
    q = np.tile([HALF, 0.0, 0.0, HALF], (n, 1))  # a quarter turn about z
    return RawFrame(seq, t_ns, bodies, np.arange(3.0 * n).reshape(n, 3), q, np.array(seen or [True] * n))


def responder(version=(4, 1), **more) -> Responder:
    return Responder(NatNetSettings(version=version, **more), 1511, None)


def test_it_says_of_itself_what_motive_says():
    """By the layout of NatNet 3.0: name of 256 bytes, two versions, frequency, data port, multicast and its group."""
    server = Responder(NatNetSettings((3, 0), 3_312_787, 0.0), 1511, "239.255.42.99")
    said = b"Motive".ljust(256, b"\0") + bytes((2, 1, 0, 0, 3, 0, 0, 0)) + pack("<QHB", 3_312_787, 1511, 1)
    said = pack("<HH", 1, 279) + said + bytes((239, 255, 42, 99))
    assert server.received(CONNECT, CLIENT, 0) == [said]
    assert server.received(pack("<HH", 14, 264) + bytes(264), CLIENT, 0) == [said]
    ticks, token = 987_656_000_000, 278_554
    echo = server.received(pack("<HHQ", 12, 8, token), CLIENT, -(-ticks * S // 3_312_787))
    assert echo == [pack("<HHQQ", 13, 16, token, ticks)]


@pytest.mark.parametrize("version", VERSIONS)
def test_a_body_is_described_as_the_versions_have_it(version):
    """Layout by hand: marker names from 4.0, byte count from 4.1, rotation from 4.2."""
    server = responder(version)
    server.show(("lead",))
    (answer,) = server.received(MODELS, CLIENT, 0)
    body = b"lead\0" + pack("<ii3f", 1, -1, 0, 0, 0)
    body += pack("<4f", 0, 0, 0, 1) if version >= (4, 2) else b""
    body += pack("<i12f4i", 4, *OFFSETS_M.ravel(), 0, 0, 0, 0)
    body += b"Marker1\0Marker2\0Marker3\0Marker4\0" if version >= (4, 0) else b""
    assert answer.endswith(pack("<i", 1) + (pack("<i", len(body)) if version >= (4, 1) else b"") + body)
    assert unpack_from("<HHi", answer) == (5, len(answer) - 4, 3)


@pytest.mark.parametrize("version", VERSIONS)
def test_a_frame_holds_number_poses_stamps_and_what_is_out_of_sight(version):
    server = responder(version, clock_hz=1000, clock_s=100.0)
    frame = server.frame(raw(seq=77, seen=[True, False]), 10 * S + 5_000_000)
    assert unpack_from("<HHi", frame) == (7, len(frame) - 4, 77)
    counts = version >= (4, 1)
    rows = pack("<ii", 2, 76) if counts else pack("<i", 2)
    at = frame.index(rows + pack("<i3f", 1, 0, 1, 2)) + len(rows)
    assert unpack_from("<i3f", frame, at) == (1, 0.0, 1.0, 2.0)
    assert unpack_from("<4f", frame, at + 16) == pytest.approx((0.0, 0.0, HALF, HALF))
    assert [unpack_from("<h", frame, at + 38 * k + 36)[0] for k in range(2)] == [1, 0]
    suffix = "<IIdQQQIIhI" if counts else "<IIdQQQhI"
    end = unpack_from(suffix, frame, len(frame) - calcsize(suffix))
    assert end[3:6] == (110_000, 110_002, 110_005)


def test_markers_lie_where_the_body_carries_them():
    """A quarter turn about z takes x to y: (x, y, z) of the body is (-y, x, z) in the cameras' axes."""
    frame = responder((3, 0)).frame(raw(("lead",)), 10 * S)
    at = frame.index(b"lead\0") + 9
    at_m = np.frombuffer(frame, "<f4", 12, at).reshape(4, 3)
    np.testing.assert_allclose(at_m - [0, 1, 2], OFFSETS_M[:, [1, 0, 2]] * [-1, 1, 1], atol=1e-6)


def test_frames_go_to_who_connected_until_silent_or_gone():
    server = responder()
    assert server.listeners(0) == []
    for client in (CLIENT, OTHER):
        server.received(CONNECT, client, 0)
    assert server.listeners(S) == [CLIENT, OTHER]
    server.received(ALIVE, CLIENT, 8 * S)
    assert server.listeners(CLIENT_NS + S) == [CLIENT]
    server.received(BYE, CLIENT, 9 * S)
    assert server.listeners(CLIENT_NS + S) == []
    assert Responder(NatNetSettings(), 1511, "239.0.0.1").listeners(0) == [("239.0.0.1", 1511)]


def test_changed_models_are_flagged_once_and_ids_stay():
    server = responder((3, 0))

    def flag(bodies) -> int:
        return int(unpack_from("<h", server.frame(raw(bodies), 10 * S)[-6:])[0])

    assert [flag(("a", "b")), flag(("a", "b"))] == [0, 0]
    assert [flag(("a", "c")), flag(("a", "c"))] == [2, 0]
    assert server.ids == {"a": 1, "c": 2}
    assert flag(("c",)) == 2
    assert server.ids == {"c": 2}
    assert flag(("c", "d")) == 2
    assert server.ids == {"c": 2, "d": 3}


def test_a_lab_files_table_gives_its_server():
    table = {"host": "127.0.0.1", "multicast": "", "data_port": 1600}
    config = MocapConfig.model_validate({"source": "natnet", "natnet": table, "unit": "mm"})
    server = natnet_server(config, ("Drone 1", "left"), REAL_TIME)
    assert list(server.responder.ids) == ["Drone 1", "left"]
    frame = server.responder.frame(raw(("Drone 1", "left")), 10 * S)
    assert pack("<i3f", 2, 3000, 4000, 5000) in frame

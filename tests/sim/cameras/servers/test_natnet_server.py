import math
from struct import pack

import numpy as np

from formation.messages import RawFrame
from sim.cameras.servers.natnet import CLIENT_NS, OFFSETS_M, NatNetSettings, Responder

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

from wire.link_messages import Address, Heartbeat, MavAutopilot
from wire.mavlink.codec import Codec
from wire.transport.udp_bus import QUIET_NS, PeerFilter

DRONE, ELSEWHERE, STRANGER = ("10.0.0.3", 14583), ("10.0.0.3", 40000), ("10.0.0.9", 5000)
BEAT = Codec(Address(3, 1)).encode(Heartbeat(MavAutopilot.PX4, 2, 0, 0, 4))
FOREIGN = Codec(Address(9, 1)).encode(Heartbeat(MavAutopilot.PX4, 2, 0, 0, 4))
S = QUIET_NS


def test_the_expected_address_is_taken_whatever_it_says_and_at_once() -> None:
    gate = PeerFilter(3, DRONE)
    assert gate.reject_reason(DRONE, b"", 0) == ""
    assert gate.reject_reason(ELSEWHERE, BEAT, 10 * S) == ""
    assert gate.reject_reason(DRONE, FOREIGN, 10 * S + 1) == ""
    assert gate.current == DRONE


def test_nobody_else_is_taken_while_the_drone_is_heard() -> None:
    gate = PeerFilter(3, DRONE)
    gate.reject_reason(DRONE, BEAT, 0)
    assert "another address" in gate.reject_reason(STRANGER, BEAT, S - 1)
    assert gate.current == DRONE


def test_a_drone_is_found_at_another_address_once_it_is_silent_at_its_own() -> None:
    gate = PeerFilter(3, DRONE)
    gate.reject_reason(DRONE, BEAT, 0)
    assert gate.reject_reason(ELSEWHERE, BEAT, S) == ""
    assert gate.reject_reason(ELSEWHERE, b"anything", S + 1) == ""
    assert gate.current == ELSEWHERE


def test_strangers_do_not_become_the_drone_by_talking() -> None:
    gate = PeerFilter(3, None)
    damaged = BEAT[:-1] + bytes([BEAT[-1] ^ 1])
    for stray in (b"", b"\xfe", b"\xfd" * 1500, FOREIGN, damaged, b"\xfd" + BEAT[1:9]):
        assert "no MAVLink of that system" in gate.reject_reason(STRANGER, stray, 0)
    assert gate.current is None
    assert gate.reject_reason(ELSEWHERE, BEAT, 1) == ""
    assert gate.current == ELSEWHERE

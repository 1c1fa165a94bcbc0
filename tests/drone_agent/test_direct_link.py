"""What a simulated autopilot sends over UDP, held against what PX4 v1.16.2 was seen to send on its off-board link."""

from collections import Counter

from formation.config import LinkConfig
from tests.drone_agent.agent_harness import MS, Harness, S
from wire.link_messages.motion import AttitudeQuaternion
from wire.mavlink.framing import FrameCutter

SEEN_HZ = {30: 100, 31: 50, 33: 50, 105: 50, 32: 30, 83: 10, 111: 10, 1: 5, 245: 5, 0: 1}


def sent_in_4_s(kind: str) -> list[list[int]]:
    """The message ids of every datagram sent of four seconds, once it is ready."""
    harness = Harness(link=LinkConfig(kind=kind))
    harness.run(4.0)  # until it knows where it is
    datagrams: list[list[int]] = []
    end_ns = harness.now_ns + 4_000_000_000
    while (due_ns := harness.core.next_deadline_ns()) <= end_ns:
        harness.now_ns = max(due_ns, harness.now_ns)
        out = harness.core.tick(harness.now_ns)
        datagrams += [[frame.number for frame in FrameCutter().cut(d.data)] for d in out.datagrams]
    return datagrams


def test_px4_over_udp_loads_a_link_as_the_real_one_does():
    datagrams = sent_in_4_s("udp")
    assert all(len(numbers) == 1 for numbers in datagrams)
    rates = Counter(numbers[0] for numbers in datagrams)
    for number, rate_hz in SEEN_HZ.items():
        assert abs(rates[number] / 4 - rate_hz) <= 1, number
    assert len(datagrams) / 4 > 300


def _attitudes_after(stall_s: float, kind: str) -> tuple[list[int], int]:
    """Boot times, ms, of all ATTITUDE_QUATERNION that one late turn sends, and how long before it the stall began."""
    harness = Harness(link=LinkConfig(kind=kind))
    harness.run(4.0)
    began_ms = harness.now_ns // MS
    out = harness.core.tick(harness.now_ns + round(stall_s * S))
    packets = [packet.message for d in out.datagrams for packet in harness.codec.receive(d.data)]
    return [m.t_boot_ms for m in packets if isinstance(m, AttitudeQuaternion)], began_ms


def test_a_process_that_had_no_turn_sends_what_the_autopilot_has_sent_meanwhile():
    """PX4 on a computer of its own goes on: the ground finds a burst, each packet as old as its stamp says."""
    boot_ms, began_ms = _attitudes_after(0.3, "udp")
    assert boot_ms == list(range(began_ms + 20, began_ms + 301, 20))
    late, _ = _attitudes_after(30.0, "udp")
    assert len(late) == 51  # a second of it: a socket's buffer holds no more
    assert len(_attitudes_after(0.3, "zenoh")[0]) == 1


def test_over_the_bus_packets_share_datagrams():
    datagrams = sent_in_4_s("zenoh")
    assert max(len(numbers) for numbers in datagrams) > 1

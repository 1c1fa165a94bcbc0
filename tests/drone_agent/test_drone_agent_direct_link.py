"""What a simulated autopilot sends over UDP, held against what PX4 v1.16.2 was seen to send on its off-board link."""

from collections import Counter

from agent_harness import Harness

from formation.config import LinkConfig
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


def test_over_the_bus_packets_share_datagrams():
    datagrams = sent_in_4_s("zenoh")
    assert max(len(numbers) for numbers in datagrams) > 1

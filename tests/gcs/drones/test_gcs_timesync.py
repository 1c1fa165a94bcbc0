import itertools
import math

from hypothesis import given
from hypothesis import strategies as st

from gcs.drones.timesync import ClockOffset
from wire.link_messages.address import Address
from wire.link_messages.clocks import TimeSync

DRONE = Address(3, 1)
MS = 1_000_000


def test_nothing_is_known_before_the_first_answer():
    clock = ClockOffset(DRONE)
    assert clock.offset_ns is None
    assert math.isnan(clock.round_trip_s)


def test_requests_come_ten_a_second_then_one():
    clock = ClockOffset(DRONE)
    asked = []
    for ms in range(0, 5000):
        request = clock.due(ms * MS)
        if request is not None:
            asked.append(ms)
            assert (request.tc1_ns, request.ts1_ns, request.target) == (0, ms * MS, DRONE)
            clock.receive(TimeSync(7, ms * MS), ms * MS)
    assert asked[:8] == [0, 100, 200, 300, 400, 500, 600, 700]
    assert {b - a for a, b in itertools.pairwise(asked[8:])} == {1000}


def test_a_request_is_answered_with_our_time():
    answer = ClockOffset(DRONE).receive(TimeSync(tc1_ns=0, ts1_ns=123), 456)
    assert (answer.tc1_ns, answer.ts1_ns, answer.target) == (456, 123, DRONE)


def test_answers_to_others_and_to_older_requests_are_not_taken():
    clock = ClockOffset(DRONE)
    clock.due(0)
    clock.due(100 * MS)
    assert clock.receive(TimeSync(tc1_ns=5, ts1_ns=0), 101 * MS) is None
    assert clock.offset_ns is None


@given(
    offset_ns=st.integers(-(10**15), 10**15),
    delays_ms=st.lists(st.tuples(st.integers(1, 50), st.integers(1, 50)), min_size=1, max_size=30),
)
def test_offset_is_within_half_the_quickest_round_trip(offset_ns, delays_ms):
    clock = ClockOffset(DRONE)
    now_ns = 10**16
    for out_ms, back_ms in delays_ms:
        now_ns += 2_000 * MS
        request = clock.due(now_ns)
        heard_ns = now_ns + out_ms * MS + offset_ns
        now_ns += (out_ms + back_ms) * MS
        clock.receive(TimeSync(heard_ns, request.ts1_ns), now_ns)
    quickest_ms = min(out + back for out, back in delays_ms[-16:])
    assert abs(clock.offset_ns - offset_ns) <= quickest_ms * MS // 2 + 1
    assert math.isclose(clock.round_trip_s, quickest_ms * 1e-3)

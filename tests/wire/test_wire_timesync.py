import itertools
import math

from wire.link_messages.address import Address
from wire.link_messages.clocks import TimeSync
from wire.timesync import TimeSyncClient

DRONE = Address(3, 1)
MS = 1_000_000


def test_nothing_is_known_before_the_first_answer():
    clock = TimeSyncClient(DRONE)
    assert clock.offset_ns is None
    assert math.isnan(clock.round_trip_s)


def test_requests_come_ten_a_second_then_one():
    clock = TimeSyncClient(DRONE)
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
    answer = TimeSyncClient(DRONE).receive(TimeSync(tc1_ns=0, ts1_ns=123), 456)
    assert (answer.tc1_ns, answer.ts1_ns, answer.target) == (456, 123, DRONE)


def test_answers_to_others_and_to_older_requests_are_not_taken():
    clock = TimeSyncClient(DRONE)
    clock.due(0)
    clock.due(100 * MS)
    assert clock.receive(TimeSync(tc1_ns=5, ts1_ns=0), 101 * MS) is None
    assert clock.offset_ns is None


def test_answers_set_the_offset():
    clock = TimeSyncClient(DRONE)
    clock.due(0)
    clock.receive(TimeSync(tc1_ns=7_000 * MS + 4 * MS, ts1_ns=0), 8 * MS)
    assert clock.offset_ns == 7_000 * MS
    assert clock.round_trip_s == 0.008

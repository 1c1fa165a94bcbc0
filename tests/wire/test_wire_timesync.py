import itertools
import math

from wire.link_messages.address import Address
from wire.link_messages.clocks import TimeSync
from wire.timesync import TimeSyncClient, slip_text

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
            clock.receive(TimeSync(ms * MS + 7, ms * MS), ms * MS)
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


def exchanged(rate: float, seconds: float, trip_ms: float = 2.0) -> tuple[TimeSyncClient, list[float]]:
    """A client of a clock that runs so fast, and by how many ms it was wrong of stamps that came between requests."""
    clock, wrong_ms = TimeSyncClient(DRONE), []
    trip_ns = round(trip_ms * MS)
    for ms in range(0, round(1000 * seconds), 10):
        now_ns = 10**12 + ms * MS
        request = clock.due(now_ns)
        if request is not None:
            theirs_ns = round(rate * (now_ns + trip_ns // 2))
            clock.receive(TimeSync(theirs_ns, request.ts1_ns), now_ns + trip_ns)
        believed_ns = clock.clock.to_ours_ns(round(rate * now_ns))
        if believed_ns is not None and ms > 2000:
            wrong_ms.append(abs(believed_ns - now_ns) / MS)
    return clock, wrong_ms


def test_a_clock_that_slips_by_a_percent_is_followed_and_named():
    for rate in (0.99, 1.01):
        clock, wrong_ms = exchanged(rate, 20.0)
        assert max(wrong_ms[100:]) < 4.0
        slip = clock.slip
        assert slip is not None
        assert abs(slip - (rate - 1.0)) < 0.001
        assert f"1.0 % {'slower' if rate < 1.0 else 'faster'}" in slip_text(slip)


def test_a_clock_that_keeps_its_rate_or_was_set_once_does_not_slip():
    clock, _ = exchanged(1.0 + 20e-6, 60.0)
    assert clock.slip is None
    clock = TimeSyncClient(DRONE)
    for ms in range(0, 20_000, 10):
        request = clock.due(ms * MS)
        if request is not None:
            ahead_ms = 10_000 if ms < 7_000 else 15_000
            clock.receive(TimeSync((ms + ahead_ms) * MS, request.ts1_ns), ms * MS)
            assert clock.slip is None
    assert clock.offset_ns == 15_000 * MS

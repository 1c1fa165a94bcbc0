"""Another clock against ours: by exchanges, by stamps alone, and by TIMESYNC."""

import itertools

from hypothesis import given
from hypothesis import strategies as st

from wire.clock_offset import DRIFT, ClockOffset, SenderClock, TimeSyncClient, rate_offset_text
from wire.link_messages import Address, TimeSync

MS = 1_000_000
BEHIND_NS = 5_000_000_000_000


def test_the_quickest_message_sets_the_difference_and_a_late_one_is_told_by_its_stamp():
    clock, made = SenderClock(), []
    for k, delay_ms in enumerate((3, 1, 9, 2)):
        now_ns = 10**12 + k * 10 * MS + delay_ms * MS
        made.append(clock.made_ns(10**12 + k * 10 * MS - BEHIND_NS, now_ns))
    assert made[0] == 10**12 + 3 * MS
    assert made[1] == 10**12 + 11 * MS
    assert abs(made[2] - (10**12 + 21 * MS)) < 10_000
    assert abs(made[3] - (10**12 + 31 * MS)) < 10_000


def test_one_forged_stamp_does_not_lock_the_sender_out():
    clock = SenderClock()
    clock.made_ns(1000 * MS, 10**12)
    clock.made_ns(2**62, 10**12 + 10 * MS)
    assert clock.made_ns(1020 * MS, 10**12 + 20 * MS) == 10**12 + 20 * MS


@given(
    offset_ns=st.integers(-(10**15), 10**15),
    delays_ms=st.lists(st.tuples(st.integers(1, 50), st.integers(1, 50)), min_size=1, max_size=30),
)
def test_the_offset_is_within_half_the_round_trip_believed_and_none_was_quicker_but_for_drift(offset_ns, delays_ms):
    clock, now_ns, trips = ClockOffset(), 10**16, []
    for out_ms, back_ms in delays_ms:
        sent_ns = now_ns + 2_000 * MS
        now_ns = sent_ns + (out_ms + back_ms) * MS
        clock.exchange(sent_ns, sent_ns + out_ms * MS + offset_ns, now_ns)
        trips.append((now_ns, (out_ms + back_ms) * MS))
    assert abs(clock.offset_ns - offset_ns) <= clock.round_trip_ns // 2 + 1
    assert clock.round_trip_ns <= min(trip_ns + (now_ns - at_ns) * DRIFT for at_ns, trip_ns in trips) + len(trips)
    assert clock.round_trip_ns in {trip_ns for _, trip_ns in trips}


def test_a_clock_that_starts_anew_is_followed_at_once():
    clock = ClockOffset()
    clock.exchange(0, 5_000 * MS, 2 * MS)
    clock.exchange(1000 * MS, 40 * MS + 10 * MS, 1020 * MS)
    assert clock.offset_ns == 40 * MS - 1000 * MS
    assert clock.to_ours_ns(40 * MS) == 1000 * MS


def test_an_exchange_that_ended_before_it_began_says_nothing():
    clock = ClockOffset()
    clock.exchange(10, 5, 9)
    assert clock.offset_ns is None
    assert clock.age_ms(0, 0) is None


DRONE = Address(3, 1)


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


def test_answers_to_others_are_not_taken():
    clock = TimeSyncClient(DRONE)
    clock.due(0)
    assert clock.receive(TimeSync(tc1_ns=5, ts1_ns=1), 101 * MS) is None
    assert clock.offset_ns is None


def test_an_answer_that_waited_for_longer_than_a_request_lasts_is_taken():
    """A ground that is seconds behind hears no other: without its clock the backlog would never be known."""
    clock = TimeSyncClient(DRONE)
    for ms in range(0, 4000, 100):
        clock.due(ms * MS)
    clock.receive(TimeSync(tc1_ns=7_000 * MS, ts1_ns=1000 * MS), 4000 * MS)
    assert clock.round_trip_s == 3.0
    assert clock.offset_ns == 4500 * MS


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
        rate_offset = clock.rate_offset
        assert rate_offset is not None
        assert abs(rate_offset - (rate - 1.0)) < 0.001
        assert f"1.0 % {'slower' if rate < 1.0 else 'faster'}" in rate_offset_text(rate_offset)


def test_a_clock_that_keeps_its_rate_or_was_set_once_does_not_slip():
    clock, _ = exchanged(1.0 + 20e-6, 60.0)
    assert clock.rate_offset is None
    clock = TimeSyncClient(DRONE)
    for ms in range(0, 20_000, 10):
        request = clock.due(ms * MS)
        if request is not None:
            ahead_ms = 10_000 if ms < 7_000 else 15_000
            clock.receive(TimeSync((ms + ahead_ms) * MS, request.ts1_ns), ms * MS)
            assert clock.rate_offset is None
    assert clock.offset_ns == 15_000 * MS

"""Another clock against ours, by exchanges and by stamps alone."""

from hypothesis import given
from hypothesis import strategies as st

from wire.clock_offset import DRIFT, ClockOffset, SenderClock

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


def test_clocks_that_part_are_followed():
    clock = ClockOffset()
    for second in range(600):
        sent_ns, trip_ns = second * 1000 * MS, (2 + second % 3) * MS
        drifted_ns = round(sent_ns * 50e-6)
        clock.exchange(sent_ns, sent_ns + trip_ns // 2 + drifted_ns, sent_ns + trip_ns)
        assert abs(clock.offset_ns - drifted_ns) < 1 * MS


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

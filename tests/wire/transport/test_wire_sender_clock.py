"""Another machine's stamps on our clock."""

from wire.transport.sender_clock import SenderClock

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

import random

from hypothesis import given
from hypothesis import strategies as st

from gcs.drones.sequence import SequenceMonitor

MS = 1_000_000


def _heard(numbers, spacing_ns=10 * MS) -> SequenceMonitor:
    watch = SequenceMonitor()
    for i, number in enumerate(numbers):
        watch.note(number % 256, i * spacing_ns)
    return watch


def test_a_whole_stream_has_no_loss_and_wraps():
    watch = _heard(range(1000))
    assert (watch.received, watch.lost, watch.loss) == (1000, 0, 0.0)


def test_lost_packets_are_counted():
    watch = _heard([0, 1, 4, 5, 10])
    assert watch.lost == 2 + 4
    assert watch.loss == 6 / 11


def test_packets_addressed_to_others_are_not_lost():
    watch = SequenceMonitor()
    watch.note(10, 0)
    watch.note(13, MS, skipped=2)
    watch.note(14, 2 * MS, skipped=2)  # in one datagram with two of another's after it
    watch.note(17, 3 * MS)
    assert watch.lost == 0


def test_an_overtaken_packet_is_neither_lost_nor_a_lap():
    watch = _heard([5, 7, 6, 8, 9])
    assert watch.lost == 0
    assert not watch.duplicate(0)


def test_a_restarted_drone_is_no_duplicate():
    assert not _heard([*range(100, 140), *range(200)]).duplicate(240 * 10 * MS)


def test_two_senders_in_turns_are_noticed_and_forgotten_when_one_leaves():
    numbers = [n for i in range(20) for n in (i, 100 + i)]
    watch = _heard(numbers)
    now_ns = len(numbers) * 10 * MS
    assert watch.duplicate(now_ns)
    assert not watch.duplicate(now_ns + 3_000 * MS)


@given(start_a=st.integers(0, 255), gap=st.integers(0, 255), seed=st.integers(0, 1000))
def test_two_senders_at_any_rates_are_noticed(start_a, gap, seed):
    rng = random.Random(seed)
    counters, numbers = [start_a, start_a + gap], []
    for _ in range(300):
        k = rng.randrange(2)
        numbers.append(counters[k])
        counters[k] += 1
    watch = SequenceMonitor()
    noticed = False
    for i, number in enumerate(numbers):
        watch.note(number % 256, i * 10 * MS)
        noticed = noticed or watch.duplicate(i * 10 * MS)
    assert noticed


def test_twins_that_count_alike_are_noticed():
    assert _heard([n for i in range(100) for n in (i, i)]).duplicate(200 * 10 * MS)
    assert _heard([n for i in range(100) for n in (i + 2, i)]).duplicate(200 * 10 * MS)


@given(share=st.floats(0.0, 1.0), loss=st.floats(0.0, 0.5), seed=st.integers(0, 1000))
def test_a_network_that_overtakes_however_often_makes_no_twin(share, loss, seed):
    rng = random.Random(seed)
    sent = [number for number in range(1000) if rng.random() >= loss]
    numbers = sorted(sent, key=lambda number: number + rng.uniform(0.0, 4.0) * (rng.random() < share))
    watch = SequenceMonitor()
    for i, number in enumerate(numbers):
        watch.note(number % 256, i * 10 * MS)
        assert not watch.duplicate(i * 10 * MS)
    assert abs(watch.loss - loss) < 0.1


@given(loss=st.floats(0.0, 0.9), seed=st.integers(0, 1000))
def test_a_lone_sender_is_never_taken_for_two_whatever_is_lost(loss, seed):
    rng = random.Random(seed)
    watch = SequenceMonitor()
    for number in range(2000):
        if rng.random() >= loss:
            watch.note(number % 256, number * 10 * MS)
            assert not watch.duplicate(number * 10 * MS)

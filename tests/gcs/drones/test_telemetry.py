"""Sequence numbers of one sender and of two; the mean specific force between two frames."""

import random

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs.drones.telemetry import SequenceMonitor, SpecificForce

MS = 1_000_000


def _heard(numbers, spacing_ns=10 * MS) -> SequenceMonitor:
    watch = SequenceMonitor()
    for i, number in enumerate(numbers):
        watch.note(number % 256, i * spacing_ns)
    return watch


def test_a_sample_counts_by_its_share_of_the_step():
    """From 6 to 16 ms: 4 ms of a force of 1, 5 of 2, 1 of 5 m/s^2."""
    force = SpecificForce()
    for t_ms, value in ((5, 0.0), (10, 1.0), (15, 2.0), (20, 5.0)):
        force.receive(t_ms * MS, np.array([value, 0.0, 0.0]), t_ms * MS)
    force.pop_mean(6 * MS)
    np.testing.assert_allclose(force.pop_mean(16 * MS), [(4 * 1.0 + 5 * 2.0 + 1 * 5.0) / 10.0, 0.0, 0.0])


def test_samples_further_apart_than_they_last_leave_steps_without_a_force():
    force = SpecificForce()
    for t_ms in (10, 110):
        force.receive(t_ms * MS, np.array([1.0, 0.0, 0.0]), t_ms * MS)
    force.pop_mean(50 * MS)
    assert force.pop_mean(60 * MS) is None
    assert force.pop_mean(100 * MS) is None
    np.testing.assert_allclose(force.pop_mean(110 * MS), [1.0, 0.0, 0.0])


def test_lost_packets_are_counted_and_a_lap_or_a_restart_is_none():
    whole = _heard(range(1000))
    assert (whole.received, whole.lost, whole.loss) == (1000, 0, 0.0)
    watch = _heard([0, 1, 4, 5, 10])
    assert (watch.lost, watch.loss) == (2 + 4, 6 / 11)
    assert not _heard([*range(100, 140), *range(200)]).duplicate(240 * 10 * MS)


def test_packets_addressed_to_others_are_not_lost():
    watch = SequenceMonitor()
    watch.note(10, 0)
    watch.note(13, MS, misaddressed=2)
    watch.note(14, 2 * MS, misaddressed=4)  # in one datagram with two of another's after it
    watch.note(17, 3 * MS, misaddressed=4)
    assert watch.lost == 0


@pytest.mark.parametrize(("apart", "count"), [(0, 100), (2, 100), (100, 20)])
def test_two_senders_in_turns_are_noticed_and_forgotten_when_one_leaves(apart, count):
    numbers = [n for i in range(count) for n in (i + apart, i)]
    watch, now_ns = _heard(numbers), len(numbers) * 10 * MS
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


@given(share=st.floats(0.0, 1.0), loss=st.floats(0.0, 0.9), seed=st.integers(0, 1000))
def test_a_network_that_loses_and_overtakes_however_often_makes_no_twin(share, loss, seed):
    """Up to half lost, however often one overtakes another; up to nine of ten lost of a lone sender in order."""
    rng, share = random.Random(seed), share if loss <= 0.5 else 0.0
    sent = [number for number in range(1000) if rng.random() >= loss]
    numbers = sorted(sent, key=lambda number: number + rng.uniform(0.0, 4.0) * (rng.random() < share))
    watch = SequenceMonitor()
    for i, number in enumerate(numbers):
        watch.note(number % 256, i * 10 * MS)
        assert not watch.duplicate(i * 10 * MS)
    assert loss > 0.5 or abs(watch.loss - loss) < 0.1

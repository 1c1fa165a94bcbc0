"""The link inside one process: delay, order, loss, determinism."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from formation.messages import Datagram
from wire.transport.memory_bus import NOTHING_DUE_NS, MemoryLink, random_delay

DATAGRAM = Datagram(1, b"x")


def test_what_is_pushed_comes_out_after_the_delay():
    link = MemoryLink[Datagram](lambda: 8_000_000)
    assert link.next_due_ns == NOTHING_DUE_NS
    link.push(100, DATAGRAM)
    assert link.next_due_ns == 8_000_100
    assert link.pop_due(8_000_099) == []
    assert link.pop_due(8_000_100) == [(8_000_100, DATAGRAM)]
    assert link.next_due_ns == NOTHING_DUE_NS
    assert link.pop_due(10**12) == []


@given(st.lists(st.integers(0, 10**6), max_size=50), st.integers(0, 2**32 - 1))
def test_nothing_overtakes_and_nothing_arrives_early(times, seed):
    link = MemoryLink[int](random_delay(0.0, 0.01, 0.3, np.random.default_rng(seed)))
    times = sorted(times)
    for i, t_ns in enumerate(times):
        link.push(t_ns, i)
    arrived = link.pop_due(10**18)
    assert len(arrived) + link.lost == len(times)
    assert [item for _, item in arrived] == sorted(item for _, item in arrived)
    assert [t for t, _ in arrived] == sorted(t for t, _ in arrived)
    assert all(t >= times[i] for t, i in arrived)


def test_the_delay_has_the_mean_and_the_loss_it_says():
    draw = random_delay(0.005, 0.002, 0.1, np.random.default_rng(1))
    delays = [draw() for _ in range(20_000)]
    kept = np.array([d for d in delays if d is not None]) * 1e-9
    assert abs(1.0 - len(kept) / len(delays) - 0.1) < 0.01
    assert kept.min() >= 0.005
    assert abs(kept.mean() - 0.007) < 1e-4

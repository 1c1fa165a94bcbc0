import numpy as np
import pytest

from formation.messages import Datagram
from sim.faults.channel import OVERTAKEN_NS, Channel, Sent
from sim.faults.fault import Family, Fault
from sim.faults.queue import DueQueue

MS = 1_000_000
DELAY_S = 0.004


def channel() -> Channel:
    return Channel(lambda: round(DELAY_S * 1e9), np.random.default_rng(1))


def sent(family: Family, severity: float, count: int = 400) -> list[tuple[int, int, bytes]]:
    """(arrival, sending, bytes), ms, of `count` datagrams sent a millisecond apart with the fault on from 0."""
    link, fault, under_way = channel(), Fault(family=family, severity=severity), DueQueue[Sent]()
    arrived = []
    for t_ms in range(count + 2000):
        if t_ms < count:
            for due_ns, item in link.send(t_ms * MS, Datagram(1, t_ms.to_bytes(4, "big")), [(fault, 0)]):
                under_way.push(due_ns, item)
        arrived += [(t_ms, item.t_ns // MS, item.datagram.data) for item in under_way.pop_due(t_ms * MS)]
    return arrived


def test_drop_loses_its_share() -> None:
    assert len(sent(Family.DROP, 0.9, 4000)) == pytest.approx(400, abs=60)
    assert sent(Family.DROP, 1.0) == []


def test_delay_is_added() -> None:
    assert {arrival - sending for arrival, sending, _ in sent(Family.DELAY, 0.15)} == {154}


def test_growing_delay_grows_with_time() -> None:
    late = {sending: arrival - sending for arrival, sending, _ in sent(Family.GROWING_DELAY, 0.5)}
    assert late[0] == 4
    assert late[100] == pytest.approx(54, abs=1)
    assert late[300] == pytest.approx(154, abs=1)


def test_reordered_datagrams_are_overtaken() -> None:
    order = [sending for _, sending, _ in sent(Family.REORDER, 0.3)]
    assert sorted(order) == list(range(400))
    assert order != sorted(order)


def test_duplicates_come_twice() -> None:
    arrived = sent(Family.DUPLICATE, 1.0)
    assert len(arrived) == 800
    assert {arrival - sending for arrival, sending, _ in arrived} == {4, 4 + OVERTAKEN_NS // MS}


def test_corruption_changes_one_byte() -> None:
    for _, sending, data in sent(Family.CORRUPT, 1.0):
        assert sum(a != b for a, b in zip(data, sending.to_bytes(4, "big"), strict=True)) == 1


def test_replay_says_again_what_was_said_then() -> None:
    arrived = sent(Family.REPLAY, 0.1, 300)
    again = [(arrival, sending) for arrival, sending, _ in arrived if arrival - sending > 50]
    assert len(arrived) == 500
    assert {arrival - sending for arrival, sending in again} == {109}

"""Who is due when: held against a look at everybody."""

import numpy as np

from sim.faults.queue import Agenda
from wire.transport.memory_bus import NOTHING_DUE_NS


def test_all_are_due_at_first_in_the_order_of_their_numbers() -> None:
    agenda = Agenda(3, 5)
    assert agenda.next_due_ns == 5
    assert agenda.pop_due(4) == []
    assert agenda.pop_due(5) == [0, 1, 2]
    assert agenda.next_due_ns == NOTHING_DUE_NS


def test_only_what_was_set_last_counts() -> None:
    agenda = Agenda(2, 0)
    agenda.pop_due(0)
    agenda.set_due(0, 30)
    agenda.set_due(1, 40)
    agenda.set_due(0, 50)  # later
    agenda.set_due(1, 20)  # sooner
    assert agenda.next_due_ns == 20
    assert agenda.pop_due(45) == [1]
    agenda.set_due(1, 20)  # once more at the same time
    assert agenda.pop_due(45) == [1]
    assert agenda.pop_due(50) == [0]


def test_any_order_of_setting_and_popping_agrees_with_a_look_at_everybody() -> None:
    rng, n = np.random.default_rng(1), 7
    agenda, due_ns = Agenda(n, 0), [0] * n
    for now_ns in range(400):
        for k in rng.integers(0, n, 3).tolist():
            due_ns[k] = now_ns + int(rng.integers(0, 5))
            agenda.set_due(k, due_ns[k])
        assert agenda.next_due_ns == min(due_ns)
        expected = [k for k in range(n) if due_ns[k] <= now_ns]
        assert agenda.pop_due(now_ns) == expected
        for k in expected:
            due_ns[k] = now_ns + int(rng.integers(1, 9))
            agenda.set_due(k, due_ns[k])

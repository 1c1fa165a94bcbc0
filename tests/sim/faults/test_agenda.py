"""Who is due when: held against a look at everybody."""

import numpy as np

from sim.faults.queue import Agenda


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

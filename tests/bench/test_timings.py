"""How many calls of Python a simulated second makes: no more than its budget; how they are counted."""

import json

import numpy as np
import pytest

from bench import timings
from bench.call_counts import Calls, python_calls
from formation.maths import frames


@pytest.mark.parametrize(("followers", "budget"), [(2, 120_107), (20, 718_926)])
def test_a_simulated_second_makes_no_more_python_calls_than_its_budget(followers: int, budget: int) -> None:
    """More than 5 % over the budget: change the code, or argue for a new budget. No load of a machine changes it."""
    assert python_calls(timings.of_size(followers)) <= 1.05 * budget


def test_calls_are_counted_while_entered_and_only_ours() -> None:
    with Calls() as calls:
        frames.wrap_angle(np.zeros(3))
        frames.wrap_angle(np.ones(3))
        json.dumps({"a": [1]})
    frames.wrap_angle(np.zeros(3))
    assert calls.count == 2

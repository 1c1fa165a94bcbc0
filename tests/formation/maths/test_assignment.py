"""The assignment of least cost, against SciPy's."""

import numpy as np
import pytest
from scipy.optimize import linear_sum_assignment

from formation.maths.assignment import assignment


@pytest.mark.parametrize("n", [1, 2, 3, 8, 60])
def test_columns_are_those_of_scipy(n: int) -> None:
    rng = np.random.default_rng(n)
    for _ in range(20):
        cost = rng.random((n, n))
        assert assignment(cost).tolist() == linear_sum_assignment(cost)[1].tolist()


@pytest.mark.parametrize("n", [2, 3, 5, 12])
def test_of_equals_the_same_is_chosen_as_by_scipy(n: int) -> None:
    rng = np.random.default_rng(n)
    for most in (1, 2, 4):
        for _ in range(50):
            cost = rng.integers(0, most, (n, n)).astype(np.float64)
            assert assignment(cost).tolist() == linear_sum_assignment(cost)[1].tolist()


def test_two_who_want_the_same_share_by_the_sum_of_costs() -> None:
    """By hand: 1 + 2 beats 0 + 4."""
    assert assignment(np.array([[0.0, 1.0], [2.0, 4.0]])).tolist() == [1, 0]


def test_what_is_no_cost_is_refused() -> None:
    for wrong in (np.nan, np.inf):
        with pytest.raises(ValueError, match="not finite"):
            assignment(np.array([[0.0, 1.0], [wrong, 4.0]]))

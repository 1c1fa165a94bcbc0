"""Points in order along an axis, against numpy's stable sort."""

import numpy as np
import pytest

from formation.maths.sweep import ascending, widest_axis


@pytest.mark.parametrize("n", [0, 1, 2, 3, 7, 8, 9, 100])
def test_the_order_is_that_of_a_stable_sort(n: int) -> None:
    rng = np.random.default_rng(n)
    values, chosen = rng.integers(0, 10, n).astype(float), rng.random(n) < 0.7
    indices = np.flatnonzero(chosen)
    np.testing.assert_array_equal(ascending(values, chosen), indices[np.argsort(values[indices], kind="stable")])


def test_the_widest_axis_is_that_of_the_chosen_among_the_first() -> None:
    points = np.array([[0.0, 0.0, 0.0], [1.0, 2.0, 3.0], [9.0, 0.0, 0.0]])
    chosen = np.array([True, True, False])
    assert widest_axis(points, chosen, 3) == 2
    assert widest_axis(points, chosen, 2) == 1
    assert widest_axis(points, np.ones(3, bool), 3) == 0
    assert widest_axis(points, np.zeros(3, bool), 3) == 0

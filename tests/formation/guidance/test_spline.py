"""The splines through points, against SciPy's."""

from math import factorial

import numpy as np
import pytest
from scipy.interpolate import make_interp_spline

from formation.guidance import spline


@pytest.mark.parametrize("order", [5, 7])
@pytest.mark.parametrize("count", [2, 3, 12, 400])
def test_pieces_are_scipys(order, count):
    rng = np.random.default_rng(count)
    t_s = np.cumsum(rng.uniform(0.05, 2.0, count))
    rows = rng.uniform(-2.0, 2.0, (count, 4))
    rest = [(k, np.zeros(4)) for k in range(1, (order + 1) // 2)]
    fitted = make_interp_spline(t_s, rows, k=order, bc_type=(rest, rest))
    pieces, _ = spline._pieces(t_s, rows, order)
    for power in range(order + 1):
        theirs = fitted.derivative(power)(t_s[:-1]) / factorial(power)
        ours = pieces[:, spline.POWERS - power :: spline.POWERS]
        np.testing.assert_allclose(ours, theirs, rtol=1e-5, atol=1e-9 + 1e-6 * np.abs(theirs).max())

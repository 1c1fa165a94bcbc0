import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from formation.maths.powers import implicit_root, sig, sig_slope

powers = st.floats(0.05, 1.0)
gains = st.floats(0.0, 100.0)
values = st.floats(-1e3, 1e3).filter(lambda x: x == 0.0 or abs(x) > 1e-100)


@given(values, powers)
def test_sig_without_smoothing_is_the_signed_power(x: float, power: float) -> None:
    assert sig(x, power, 0.0) == pytest.approx(np.sign(x) * abs(x) ** power, rel=1e-12)


@given(values, powers, st.floats(0.01, 1.0))
def test_sig_is_odd_and_its_slope_is_its_derivative(x: float, power: float, smooth: float) -> None:
    assert sig(-x, power, smooth) == -sig(x, power, smooth)
    h = 1e-6 * max(1.0, abs(x))
    numeric = (sig(x + h, power, smooth) - sig(x - h, power, smooth)) / (2.0 * h)
    assert sig_slope(x, power, smooth) == pytest.approx(numeric, rel=1e-4, abs=1e-6)


@given(values, gains, powers, gains, powers, gains, powers, st.sampled_from([0.0, 0.1, 1.0]))
def test_implicit_root_solves_its_equation(
    y: float, k1: float, p1: float, k2: float, p2: float, k3: float, p3: float, smooth: float
) -> None:
    x = implicit_root(y, k1, p1, k2, p2, k3, p3, smooth)
    left = x + k1 * sig(x, p1, smooth) + k2 * sig(x, p2, smooth) + k3 * sig(x, p3, smooth)
    assert left == pytest.approx(y, rel=1e-9, abs=1e-12)
    assert abs(x) <= abs(y) * (1.0 + 1e-12)
    assert x * y >= 0.0

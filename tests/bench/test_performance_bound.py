import numpy as np
import pytest

from bench.performance_bound import STEP_S, AttitudeLoop, gust_push, least_deviation_by_attitude_m
from sim.scenario import load


def test_a_flight_without_a_fan_is_refused() -> None:
    with pytest.raises(ValueError, match="triangle_line has no fan"):
        gust_push(load("triangle_line"))


@pytest.mark.parametrize("push_m_s2", [1.0, 3.0])
def test_a_steady_push_against_a_quick_loop(push_m_s2: float) -> None:
    """Dead for 0.1 s, then 5 m/s^2 against it at once: p t^2 / 2, and the way in which that stops it."""
    loop = AttitudeLoop(dead_s=0.1, lag_s=1e-6, most_m_s2=5.0)
    least_m = least_deviation_by_attitude_m(np.full(round(2.0 / STEP_S), push_m_s2), loop)
    by_hand_m = 0.5 * push_m_s2 * 0.1**2 + (push_m_s2 * 0.1) ** 2 / (2.0 * (5.0 - push_m_s2))
    assert least_m == pytest.approx(by_hand_m, rel=0.01)


def test_a_lag_counts_as_so_much_more_dead_time_against_a_weak_push() -> None:
    """Far from the limit the force is needed late: (1 - e^(-t / lag)) most grows like a line through the dead time."""
    quick, slow = (
        least_deviation_by_attitude_m(np.full(1000, 0.5), AttitudeLoop(0.05, lag_s, 7.0)) for lag_s in (1e-6, 0.05)
    )
    assert quick < slow < 0.5 * 0.5 * 0.15**2

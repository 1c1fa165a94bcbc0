import numpy as np
import pytest

from formation.maths.arrays import Float
from formation.maths.records import Rows
from formation.vehicle.response import NEVER_NS, SentCommands, answer, no_history, remember


def answered(
    history: Rows[SentCommands], axes: slice, from_ns: int, to_ns: int, dead_s: float, lag_s: float, felt: float
) -> tuple[Float, Float, Float]:
    sent = history[0].force[:, axes]
    k = sent.shape[1]
    out = np.full(k, felt), np.full(k, np.nan), np.full(k, np.nan)
    answer(history[0].t_ns, sent, from_ns, to_ns, dead_s, lag_s, *out)
    return out


def test_answer_is_dead_time_then_first_order_lag() -> None:
    history = remember(no_history(1), 0, np.array([[2.0, 0.0, 0.0, 2.0]]))
    (felt, _), (speed, _), (travel, _) = answered(history, slice(0, 2), 0, 300_000_000, 0.1, 0.05, 0.0)
    after = 0.2
    assert felt == pytest.approx(2.0 * (1.0 - np.exp(-after / 0.05)))
    assert speed == pytest.approx(2.0 * (after - 0.05 * (1.0 - np.exp(-after / 0.05))))
    assert travel == pytest.approx(2.0 * (0.5 * after**2 - 0.05 * (after - 0.05 * (1.0 - np.exp(-after / 0.05)))))


def test_answer_agrees_with_small_steps_through_many_commands() -> None:
    rng = np.random.default_rng(4)
    history = no_history(1)
    for k in range(40):
        history = remember(history, k * 10_000_000, rng.normal(size=(1, 4)))
    sent, dead_s, lag_s = history[0].force[:, 1], 0.037, 0.06
    (felt,), (speed,), (travel,) = answered(history, slice(1, 2), 50_000_000, 350_000_000, dead_s, lag_s, 0.3)
    f, v, x, dt_ns = 0.3, 0.0, 0.0, 10_000
    for t_ns in range(50_000_000, 350_000_000, dt_ns):
        index = np.searchsorted(history[0].t_ns, t_ns - int(dead_s * 1e9), side="right") - 1
        f += dt_ns * 1e-9 / lag_s * (sent[index] - f)
        x += dt_ns * 1e-9 * v
        v += dt_ns * 1e-9 * f
    assert (felt, speed, travel) == pytest.approx((f, v, x), abs=2e-4)


def test_nothing_sent_is_nothing_felt() -> None:
    history = no_history(2)
    assert history[0].t_ns[0] == NEVER_NS
    for numbers in answered(history, slice(0, 3), 0, 10**9, 0.1, 0.05, 0.0):
        assert not numbers.any()


def test_remember_forgets_the_oldest() -> None:
    history = no_history(1)
    for k in range(300):
        history = remember(history, k, np.full((1, 4), float(k)))
    assert history[0].t_ns[-1] == 299
    assert history[0].t_ns[0] == 300 - len(history[0].t_ns)

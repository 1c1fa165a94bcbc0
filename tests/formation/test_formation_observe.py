from collections.abc import Callable
from math import asin, cos, sin

import numpy as np
import pytest

from formation.arrays import Float
from formation.observe import MISFIT_BAD, MISFIT_FAIR, Memory, judge_answer
from formation.rigid_body import GRAVITY_M_S2

MS = 1_000_000
BELIEF = np.array([0.05, 0.05])  # dead time, lag, s
DT_S = 0.01


def _memory() -> Memory:
    """One vehicle that hovers."""
    zeros = {name: np.zeros((1, 4)) for name in Memory._fields}
    zeros |= {"lift": np.full(1, GRAVITY_M_S2), "believed": np.zeros((1, 2)), "missed": np.zeros((1, 3))}
    return Memory(**{**zeros, "misfit": np.zeros(1)})


def _ordered(t_s: float) -> float:
    """Specific force asked for sideways, m/s^2: a hard swing of two tones."""
    return 3.0 * sin(9.0 * t_s) + 2.0 * sin(14.0 * t_s + 1.0)


def _misfit(dead_s: float, lag_s: float, limit: Callable[[float], float] = lambda rate: rate) -> float:
    """Of a vehicle with this response, its rate of change (m/s^3) passed through `limit`, after eight seconds."""
    memory, felt, fine = _memory(), 0.0, 10
    sent: list[tuple[int, float]] = [(-(10**18), 0.0)]
    for k in range(800):
        sent.append((k * 10 * MS, _ordered(k * DT_S)))
        history = sent[-64:]
        for j in range(fine):
            t_s = k * DT_S + j * DT_S / fine - dead_s
            felt += DT_S / fine * limit((_ordered(t_s - t_s % DT_S if t_s > 0.0 else 0.0) - felt) / lag_s)
        half = 0.5 * asin(felt / GRAVITY_M_S2)
        memory.q[0] = cos(half), 0.0, sin(half), 0.0
        times = np.array([t for t, _ in history], dtype=np.int64)
        forces: Float = np.array([(force, 0.0, 0.0, 0.0) for _, force in history])
        judge_answer(0, memory, k * 10 * MS, (k + 1) * 10 * MS, True, BELIEF, times, forces)
    return float(memory.misfit[0])


def test_a_vehicle_that_answers_as_its_profile_says_fits() -> None:
    assert _misfit(0.05, 0.05) < 0.03


@pytest.mark.parametrize(("dead_s", "lag_s"), [(0.08, 0.05), (0.02, 0.05), (0.05, 0.075), (0.05, 0.025)])
def test_a_plain_shift_in_time_is_no_misfit(dead_s: float, lag_s: float) -> None:
    assert _misfit(dead_s, lag_s) < 0.3 * MISFIT_FAIR


def test_a_vehicle_whose_motors_cannot_follow_does_not_fit() -> None:
    assert _misfit(0.05, 0.05, lambda rate: min(max(rate, -10.0), 10.0)) > MISFIT_BAD

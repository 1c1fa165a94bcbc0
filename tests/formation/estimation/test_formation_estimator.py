from collections.abc import Callable
from math import asin, cos, sin

import numpy as np
import pytest

from formation.estimation.update import MISFIT_BAD, MISFIT_FAIR, SHIFT_MOST, Memory, judge_answer
from formation.maths.arrays import Float
from formation.vehicle.body import GRAVITY_M_S2

MS = 1_000_000
BELIEF = np.array([0.05, 0.05])  # dead time, lag, s
DT_S = 0.01


def _memory() -> Memory:
    """One vehicle that hovers."""
    zeros = {name: np.zeros((1, 4)) for name in Memory._fields}
    zeros |= {"lift": np.full(1, GRAVITY_M_S2), "strength": np.ones(1), "missed": np.zeros((1, 3))}
    zeros |= {name: np.zeros((1, 2)) for name in ("believed", "trim")}
    return Memory(**{**zeros, "misfit": np.zeros(1), "shift_s": np.zeros(1)})


def _ordered(t_s: float) -> float:
    """Specific force asked for sideways, m/s^2: a hard swing of two tones."""
    return 3.0 * sin(9.0 * t_s) + 2.0 * sin(14.0 * t_s + 1.0)


def _judged(dead_s: float, lag_s: float, limit: Callable[[float], float] = lambda rate: rate) -> tuple[float, float]:
    """Misfit and shift, s, seen after eight seconds of a vehicle with this response.

    limit: what becomes of its force's rate of change, m/s^3.
    """
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
    return float(memory.misfit[0]), float(memory.shift_s[0])


def test_a_vehicle_that_answers_as_its_profile_says_fits() -> None:
    misfit, shift_s = _judged(0.05, 0.05)
    assert misfit < 0.03
    assert abs(shift_s) < 0.002


@pytest.mark.parametrize(("dead_s", "lag_s", "expected_s"), [
    (0.07, 0.05, -0.020), (0.03, 0.05, 0.020),
    (0.05, 0.07, -0.012), (0.05, 0.03, 0.016),  # of phase: (atan(0.05 w) - atan(lag w)) / w, at w 14 and 9 rad/s
])  # fmt: skip
def test_an_answer_that_is_late_or_early_is_a_shift_and_no_misfit(
    dead_s: float, lag_s: float, expected_s: float
) -> None:
    misfit, shift_s = _judged(dead_s, lag_s)
    assert misfit < 0.3 * MISFIT_FAIR
    assert shift_s == pytest.approx(expected_s, abs=0.003)


def test_a_shift_is_counted_on_only_so_far() -> None:
    assert _judged(0.10, 0.05)[1] == pytest.approx(-SHIFT_MOST * 0.1)


def test_a_vehicle_whose_motors_cannot_follow_does_not_fit_and_has_no_shift() -> None:
    misfit, shift_s = _judged(0.05, 0.05, lambda rate: min(max(rate, -10.0), 10.0))
    assert misfit > MISFIT_BAD
    assert shift_s == 0.0


def test_a_lasting_lean_that_answers_no_command_is_a_disturbance_and_no_misfit() -> None:
    memory = _memory()
    leaned = 0.15  # m/s^2: what a degree of an autopilot's error of level makes of gravity
    half = 0.5 * asin(leaned / GRAVITY_M_S2)
    memory.q[0] = cos(half), 0.0, sin(half), 0.0
    times, forces = np.array([-(10**18)], dtype=np.int64), np.zeros((1, 4))
    memory.force[0, 0] = leaned
    for k in range(400):
        judge_answer(0, memory, k * 10 * MS, (k + 1) * 10 * MS, True, BELIEF, times, forces)
        assert memory.force[0, 0] + memory.dist[0, 0] == pytest.approx(leaned)
    assert memory.dist[0, 0] == pytest.approx(leaned, rel=0.01)
    assert memory.misfit[0] < 0.2

"""How a vehicle answers what it was sent, and how an answer that differs from its profile is found."""

from collections.abc import Callable
from math import asin, atan, cos, sin

import numpy as np
import pytest

from formation.estimation.response import (
    MISMATCH_BAD,
    MISMATCH_FAIR,
    NEVER_NS,
    SentCommands,
    answer,
    learn_shift,
    learn_thrust_scale,
    no_history,
    observe_tilt,
    remember,
    update_model_mismatch,
)
from formation.estimation.settings import ObserverSettings
from formation.estimation.state import ModelError, VehicleEstimate
from formation.maths.arrays import Float
from formation.maths.records import Rows, blank
from formation.vehicle.body import GRAVITY_M_S2


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


MS = 1_000_000
DT_S = 0.01
SHIFT_MOST_S = 0.06


def _hovering() -> VehicleEstimate:
    """One vehicle that hovers."""
    z = blank(VehicleEstimate, 1)[0]
    z.thrust_m_s2, z.thrust_scale = GRAVITY_M_S2, 1.0
    return z


def test_downwash_is_not_learned_into_the_thrust() -> None:
    z, settings = _hovering(), _believed()
    z.specific_force_lab_m_s2[2], z.dist_lab_m_s2[2], z.downwash_m_s2 = GRAVITY_M_S2, -2.0, -2.0
    settings.thrust_scale_lag_s = 2.0
    learn_thrust_scale(z, DT_S, settings)
    assert (z.thrust_scale, z.dist_lab_m_s2[2]) == (1.0, -2.0)


def _believed() -> ObserverSettings:
    """A dead time and a lag of 50 ms."""
    settings = blank(ObserverSettings, 1)[0]
    settings.nominal_dead_s = settings.nominal_lag_s = 0.05
    settings.delay_shift_most_s = SHIFT_MOST_S
    return settings


def _sent(commands: list[tuple[int, float]]) -> SentCommands:
    """What was sent when, ns and m/s^2 along x; nothing before the first."""
    sent = blank(SentCommands, 1)[0]
    sent.t_ns[:] = NEVER_NS
    sent.t_ns[-len(commands) :] = [t_ns for t_ns, _ in commands]
    sent.force[-len(commands) :, 0] = [force for _, force in commands]
    return sent


def _ordered(t_s: float) -> float:
    """Specific force asked for sideways, m/s^2: a hard swing of two tones."""
    return 3.0 * sin(9.0 * t_s) + 2.0 * sin(14.0 * t_s + 1.0)


def _judged(dead_s: float, lag_s: float, limit: Callable[[float], float] = lambda rate: rate) -> tuple[float, float]:
    """Mismatch and shift, s, seen after eight seconds of a vehicle with this response.

    limit: what becomes of its force's rate of change, m/s^3.
    """
    z, felt, fine = _hovering(), 0.0, 10
    sent: list[tuple[int, float]] = []
    for k in range(800):
        sent.append((k * 10 * MS, _ordered(k * DT_S)))
        for j in range(fine):
            t_s = k * DT_S + j * DT_S / fine - dead_s
            felt += DT_S / fine * limit((_ordered(t_s - t_s % DT_S if t_s > 0.0 else 0.0) - felt) / lag_s)
        half = 0.5 * asin(felt / GRAVITY_M_S2)
        z.q_lab_from_flu[:] = cos(half), 0.0, sin(half), 0.0
        update_model_mismatch(z, k * 10 * MS, (k + 1) * 10 * MS, True, _believed(), _sent(sent[-64:]))
    return float(z.model_error.mismatch), float(z.model_error.delay_shift_s)


def test_a_vehicle_that_answers_as_its_profile_says_fits() -> None:
    mismatch, shift_s = _judged(0.05, 0.05)
    assert mismatch < 0.03
    assert abs(shift_s) < 0.002


@pytest.mark.parametrize(("dead_s", "lag_s", "expected_s"), [
    (0.07, 0.05, -0.020), (0.03, 0.05, 0.020),
    (0.05, 0.07, -0.012), (0.05, 0.03, 0.016),  # of phase: (atan(0.05 w) - atan(lag w)) / w, at w 14 and 9 rad/s
])  # fmt: skip
def test_an_answer_that_is_late_or_early_is_a_shift_and_no_mismatch(
    dead_s: float, lag_s: float, expected_s: float
) -> None:
    mismatch, shift_s = _judged(dead_s, lag_s)
    assert mismatch < 0.3 * MISMATCH_FAIR
    assert shift_s == pytest.approx(expected_s, abs=0.003)


def test_a_shift_is_believed_by_half_where_rates_are_as_small_as_their_noise() -> None:
    """0.25 m/s^3: of 20 ms that what is missed says, 10 are counted on."""
    error = blank(ModelError, 1)[0]
    error.slow_rate_m_s3[0], error.slow_innovation_m_s2[0] = 0.25, 0.25 * 0.02
    learn_shift(error, 1e3, SHIFT_MOST_S)
    assert error.delay_shift_s == pytest.approx(0.01)


def test_a_shift_is_counted_on_only_so_far() -> None:
    assert _judged(0.13, 0.05)[1] == pytest.approx(-SHIFT_MOST_S)


def test_a_vehicle_whose_motors_cannot_follow_does_not_fit_and_has_no_shift() -> None:
    mismatch, shift_s = _judged(0.05, 0.05, lambda rate: min(max(rate, -10.0), 10.0))
    assert mismatch > MISMATCH_BAD
    assert shift_s == 0.0


def test_a_lasting_lean_that_answers_no_command_is_a_disturbance_and_no_mismatch() -> None:
    z = _hovering()
    leaned = 0.15  # m/s^2: what a degree of an autopilot's error of level makes of gravity
    half = 0.5 * asin(leaned / GRAVITY_M_S2)
    z.q_lab_from_flu[:] = cos(half), 0.0, sin(half), 0.0
    z.specific_force_lab_m_s2[0] = leaned
    for k in range(400):
        update_model_mismatch(z, k * 10 * MS, (k + 1) * 10 * MS, True, _believed(), _sent([(0, 0.0)]))
        assert z.specific_force_lab_m_s2[0] + z.dist_lab_m_s2[0] == pytest.approx(leaned)
    assert z.dist_lab_m_s2[0] == pytest.approx(leaned, rel=0.01)
    assert z.model_error.mismatch < 0.2


def test_a_tilt_that_turns_steadily_is_known_with_its_rate_which_decays() -> None:
    """Of a vehicle that is only observed and rises with 1.2 m/s^2: force and rate are (g + 1.2) tan(tilt) and so on."""
    settings, z = blank(ObserverSettings, 1)[0], _hovering()
    settings.tilt_bandwidth_rad_s, z.adaptive_gain, z.dist_lab_m_s2[2] = 18.0, 1.0, 1.2
    lift, slope_1_s = GRAVITY_M_S2 + 1.2, 0.2

    def observe(k: int) -> None:
        half = 0.5 * atan(slope_1_s * k * DT_S)
        z.q_lab_from_flu[:] = cos(half), 0.0, sin(half), 0.0
        observe_tilt(z, True, DT_S, settings)

    for k in range(1, 101):
        observe(k)
    assert z.specific_force_lab_m_s2[0] == pytest.approx(lift * slope_1_s, rel=1e-3)
    assert z.observed.force_rate_lab_m_s3[0] == pytest.approx(lift * slope_1_s, rel=1e-3)
    settings.tilt_decay_1_s, before = 11.0, float(z.observed.tilt_rate_1_s[0])
    observe(101)
    assert z.observed.tilt_rate_1_s[0] == pytest.approx(before * np.exp(-0.11), rel=1e-3)

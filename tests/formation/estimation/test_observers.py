"""The observers: two in parallel, quiet until a push and quick to believe it; accelerometer."""

import numpy as np
import pytest

from formation.control.presets import DEFAULT, OBSERVER
from formation.estimation.observers import (
    blending_weight,
    learn_noise,
    noise_thresholds,
    observe_parallel,
    receive_inertial,
)
from formation.estimation.settings import ObserverGains, ObserverSettings, Parallel
from formation.estimation.state import VehicleEstimate
from formation.maths.arrays import Float, Vec3
from formation.maths.frames import from_rotation_vector, inverse, rotate
from formation.maths.records import Rows, blank, copied

DT_S, NOISE_M = 0.01, 1e-4
STILL = np.zeros(3)


def _settings(slow: ObserverGains = OBSERVER, fast: Parallel = DEFAULT.parallel) -> ObserverSettings:
    settings = blank(ObserverSettings, 1)[0]
    for name in ObserverGains.__slots__:
        setattr(settings.horizontal, name, getattr(slow, name))
    for name in Parallel.__slots__:
        setattr(settings.parallel, name, getattr(fast, name))
    return settings


def _at_rest() -> Rows[VehicleEstimate]:
    z = blank(VehicleEstimate, 1)
    z["noise"]["var_m2"] = NOISE_M**2
    return z


def _step(z: VehicleEstimate, measured: Float, settings: ObserverSettings) -> None:
    observe_parallel(z, measured, STILL, DT_S, 1.0, settings.horizontal, settings.parallel)


@pytest.mark.parametrize(
    ("ratio", "fast_weight"), [(0.0, 0.0), (0.5, 1.0 / 17.0), (1.0, 0.5), (3.0, 81.0 / 82.0), (1e99, 1.0)]
)
def test_the_blending_weight(ratio: float, fast_weight: float) -> None:
    assert blending_weight(ratio) == pytest.approx(fast_weight)


def test_what_noise_alone_shows_of_each_derivative() -> None:
    """0.1 mm at 100 Hz through 25 rad/s: half of it; each derivative another 25 rad/s; all times so many sigmas."""
    out = np.zeros(3)
    noise_thresholds(1e-4, 25.0, 0.01, _settings(fast=Parallel(25.0, 2.0, 4.0, 6.0)).parallel, out)
    assert out == pytest.approx([2 * 0.5e-4, 4 * 0.5e-4 * 25.0, 6 * 0.5e-4 * 625.0])


def test_in_calm_it_stays_with_the_slow_observer() -> None:
    rng = np.random.default_rng(4)
    z, settings = _at_rest(), _settings()
    weights, disturbances = [], []
    for _ in range(1000):
        _step(z[0], NOISE_M * rng.standard_normal(3), settings)
        weights.append(float(z[0].fast.weight))
        disturbances.append(float(z[0].dist_lab_m_s2[0]))
    assert np.mean(weights) < 0.02
    assert np.std(disturbances) < 0.05


def test_a_push_is_believed_within_five_frames_and_known_within_ten() -> None:
    """5 m/s^2 along x; y, which is not pushed, stays where it is but for noise."""
    rng = np.random.default_rng(5)
    z, settings = _at_rest(), _settings()
    for _ in range(100):
        _step(z[0], NOISE_M * rng.standard_normal(3), settings)
    weights, estimates = [], []
    for k in range(1, 11):
        truth = np.array([2.5 * (k * DT_S) ** 2, 0.0, 0.0])
        _step(z[0], truth + NOISE_M * rng.standard_normal(3), settings)
        weights.append(float(z[0].fast.weight))
        estimates.append(z[0].dist_lab_m_s2[:2].copy())
    assert max(weights[:5]) > 0.9
    assert estimates[-1][0] == pytest.approx(5.0, rel=0.2)
    assert abs(estimates[-1][1]) < 1.5


def _weights(shown_m: Float, settings: ObserverSettings | None = None) -> Float:
    """The fast observer's weight while a body is seen at shown_m (k, 3)."""
    z, settings, weights = _at_rest(), settings or _settings(), []
    for measured in shown_m:
        _step(z[0], measured, settings)
        weights.append(float(z[0].fast.weight))
    return np.array(weights)


@pytest.mark.parametrize("speed", [1.0, 0.5])
def test_a_swing_is_no_push(speed: float) -> None:
    """At 3 Hz and 2 cm along a slanted line: after four reversals, in 0.8 s, the slow observer has the most of it.

    A vehicle half as fast swings at half of 3 Hz, and its observers are half as fast.
    """
    t = DT_S * np.arange(1, round(300 / speed) + 1)
    settings = _settings(OBSERVER.scaled(speed), DEFAULT.parallel.scaled(speed))
    weights = _weights(0.02 * np.sin(6.0 * np.pi * speed * t)[:, None] * np.array([0.8, -0.6, 0.0]), settings)
    assert weights[: round(15 / speed)].max() > 0.9
    assert weights[round(80 / speed) :].max() < 0.45
    assert weights[round(150 / speed) :].mean() < 0.15


def test_a_push_that_ends_is_a_push_both_times() -> None:
    """5 m/s^2 for 0.3 s: the weight is whole when it comes and when it goes."""
    t = DT_S * np.arange(1, 61)
    x = np.where(t < 0.3, 2.5 * t * t, 0.225 + 1.5 * (t - 0.3))
    weights = _weights(np.stack([x, 0.0 * t, 0.0 * t], axis=-1))
    assert weights[5:30].min() > 0.9
    assert weights[40:50].min() > 0.9  # they change sides within 0.1 s


def test_what_is_moved_in_the_estimate_is_moved_in_both_observers() -> None:
    """As the thrust scale and the level bias are: the same motion under another model is the same estimate again."""
    rng = np.random.default_rng(6)
    z, settings = _at_rest(), _settings()
    for _ in range(30):
        _step(z[0], 1e-3 * rng.standard_normal(3), settings)
    moved, by = copied(z), np.array([0.7, -0.4, 0.0])
    for axis in range(2):
        moved[0].dist_lab_m_s2[axis] += by[axis]
    for _ in range(5):
        measured = 1e-3 * rng.standard_normal(3)
        observe_parallel(z[0], measured, STILL, DT_S, 1.0, settings.horizontal, settings.parallel)
        observe_parallel(moved[0], measured, -by, DT_S, 1.0, settings.horizontal, settings.parallel)
    assert moved[0].dist_lab_m_s2[:2] - by[:2] == pytest.approx(z[0].dist_lab_m_s2[:2], abs=1e-9)
    assert moved[0].pos_lab_m == pytest.approx(z[0].pos_lab_m, abs=1e-12)


def test_one_weight_makes_it_the_same_in_every_direction() -> None:
    """A push at 45 degrees is estimated as the same push along x, turned."""
    quarter, settings = np.sqrt(0.5), _settings(ObserverGains(8.0, 0.0, 0.004), Parallel(90.0))
    along, across = _at_rest(), _at_rest()
    for k in range(1, 12):
        x = 2.0 * (k * DT_S) ** 2
        _step(along[0], np.array([x, 0.0, 0.0]), settings)
        _step(across[0], np.array([quarter * x, quarter * x, 0.0]), settings)
    assert across[0].fast.weight == pytest.approx(float(along[0].fast.weight))
    assert across[0].dist_lab_m_s2[:2] == pytest.approx(quarter * along[0].dist_lab_m_s2[0], rel=1e-9)


DT_S, G = 0.01, 9.8
LEVEL = np.array([1.0, 0.0, 0.0, 0.0])
UP = np.array([0.0, 0.0, G])
NO_DRAG = np.zeros(3)


def _hovering(q: Float = LEVEL) -> Rows[VehicleEstimate]:
    z = blank(VehicleEstimate, 1)
    z["thrust_scale"], z["thrust_m_s2"], z["q_lab_from_flu"] = 1.0, G, q
    z["inertial"]["var_m2_s4"] = 0.04
    return z


def _feel(z: VehicleEstimate, force_flu_m_s2: Vec3, steps: int = 1) -> None:
    for _ in range(steps):
        receive_inertial(z, z.q_lab_from_flu.copy(), force_flu_m_s2, DT_S, NO_DRAG)


def _fast_z3(z: VehicleEstimate) -> Float:
    return np.asarray(z.dist_lab_m_s2[:2] + (1.0 - z.fast.weight) * z.fast.minus_slow[2, :2])


@pytest.mark.parametrize("turn", [(0.0, 0.0, 0.0), (0.2, -0.3, 0.0), (0.1, 0.4, 2.5)])
def test_a_push_is_the_fast_observers_z3_in_one_step(turn: tuple[float, float, float]) -> None:
    """Whatever way the vehicle leans and heads: what is felt besides the thrust along its own z."""
    q, push = from_rotation_vector(np.array(turn)), np.array([4.0, -3.0, 0.0])
    z = _hovering(q)
    _feel(z[0], UP + rotate(inverse(q), push))
    assert _fast_z3(z[0]) == pytest.approx(push[:2], rel=0.01)
    assert z[0].inertial.ratio > 1.0


def test_a_push_that_z3_has_already_is_none_besides() -> None:
    z, push = _hovering(), np.array([4.0, -3.0, 0.0])
    z["dist_lab_m_s2"] = push
    _feel(z[0], UP + push, 20)
    assert _fast_z3(z[0]) == pytest.approx(push[:2])


@pytest.mark.parametrize("noise_m", [3e-4, 1e-3])
def test_the_noise_of_positions_is_learned_of_whatever_moves_along_a_parabola(noise_m: float) -> None:
    z, rng = _hovering(), np.random.default_rng(2)
    z["noise"]["var_m2"], z["noise"]["recent_ns"] = 4e-8, -1_000_000_000
    for k in range(1500):
        t_s = k * DT_S
        pos = np.array([t_s, 0.5 * t_s * t_s, -0.2 * t_s * t_s]) + noise_m * rng.standard_normal(3)
        learn_noise(z[0], round(t_s * 1e9), pos)
    assert np.sqrt(z[0].noise.var_m2) == pytest.approx(noise_m, rel=0.15)


def test_a_turn_within_the_step_is_counted_by_its_mean() -> None:
    """From 0.1 to 0.2 rad about y under a push along x: felt at 0.15 rad."""
    push, z = np.array([4.0, 0.0, 0.0]), _hovering(from_rotation_vector(np.array([0.0, 0.2, 0.0])))
    halfway = from_rotation_vector(np.array([0.0, 0.15, 0.0]))
    receive_inertial(
        z[0], from_rotation_vector(np.array([0.0, 0.1, 0.0])), UP + rotate(inverse(halfway), push), DT_S, NO_DRAG
    )
    assert _fast_z3(z[0]) == pytest.approx(push[:2], abs=0.05)


def test_drag_is_no_disturbance() -> None:
    """At 2 and -1 m/s a drag of 0.5 1/s is measured as -1 and 0.5 m/s^2; a push of 4 m/s^2 beside it is still seen."""
    drag_1_s = np.array([0.5, 0.5, 0.5])
    for push_m_s2 in (0.0, 4.0):
        z = _hovering()
        z["vel_lab_m_s"] = [[2.0, -1.0, 0.0]]
        measured = UP + np.array([push_m_s2 - 1.0, 0.5, 0.0])
        receive_inertial(z[0], LEVEL, measured, DT_S, drag_1_s)
        assert _fast_z3(z[0]) == pytest.approx([push_m_s2, 0.0], abs=0.04)


def test_noise_hardly_moves_it_and_is_learned() -> None:
    rng, z, seen = np.random.default_rng(5), _hovering(), []
    for _ in range(3000):
        _feel(z[0], UP + 0.3 * rng.standard_normal(3))
        z["fast"]["minus_slow"] *= 0.8  # positions say that nothing pushes
        seen.append(_fast_z3(z[0])[0])
    assert np.sqrt(z[0].inertial.var_m2_s4) == pytest.approx(0.3, rel=0.15)
    assert np.std(seen) < 0.03


def test_a_small_bias_is_learned_and_no_push() -> None:
    z = _hovering()
    _feel(z[0], UP + np.array([0.3, -0.2, 0.0]), 1000)
    assert z[0].inertial.bias_m_s2 == pytest.approx([0.3, -0.2], rel=0.02)
    assert np.abs(_fast_z3(z[0])).max() < 0.01


def test_a_sensor_that_is_wrong_for_good_is_believed_for_some_seconds_only() -> None:
    z = _hovering()
    _feel(z[0], UP + np.array([6.0, 0.0, 0.0]), 10)
    assert _fast_z3(z[0])[0] == pytest.approx(6.0, rel=0.1)
    _feel(z[0], UP + np.array([6.0, 0.0, 0.0]), 3000)
    assert z[0].inertial.bias_m_s2[0] == pytest.approx(6.0, rel=0.1)
    assert z[0].inertial.ratio < 0.5


def test_no_more_is_believed_than_z3_may_be() -> None:
    z = _hovering()
    _feel(z[0], np.array([150.0, -150.0, 100.0]))
    assert np.abs(_fast_z3(z[0])).max() <= 14.0


def test_where_nothing_is_measured_nothing_is_different() -> None:
    z, before = _hovering(), _hovering()
    _feel(z[0], np.array([np.nan, 0.0, 0.0]), 100)
    assert z.tobytes() == before.tobytes()


def test_a_push_that_was_felt_last_is_soon_forgotten() -> None:
    z = _hovering()
    _feel(z[0], UP + np.array([4.0, 0.0, 0.0]))
    _feel(z[0], np.full(3, np.nan), 20)
    assert z[0].inertial.ratio < 0.05

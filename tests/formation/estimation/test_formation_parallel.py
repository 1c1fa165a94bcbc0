"""Two observers in parallel: quiet while nothing pushes, and quick to believe a push."""

import numpy as np
import pytest

from formation.control.presets import DEFAULT, OBSERVER
from formation.estimation.parallel import noise_thresholds, observe_parallel, open_gate
from formation.estimation.settings import ObserverGains, ObserverSettings, Parallel
from formation.estimation.state import VehicleEstimate
from formation.maths.arrays import Float
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
    z["noise_var_m2"] = NOISE_M**2
    return z


def _step(z: VehicleEstimate, measured: Float, settings: ObserverSettings) -> None:
    observe_parallel(z, measured, STILL, DT_S, 1.0, settings.horizontal, settings.parallel)


@pytest.mark.parametrize(
    ("ratio", "gate"), [(0.0, 0.0), (0.5, 1.0 / 17.0), (1.0, 0.5), (3.0, 81.0 / 82.0), (1e99, 1.0)]
)
def test_the_gate(ratio: float, gate: float) -> None:
    assert open_gate(ratio) == pytest.approx(gate)


def test_what_noise_alone_shows_of_each_derivative() -> None:
    """0.1 mm at 100 Hz through 25 rad/s: half of it; each derivative another 25 rad/s; all times so many sigmas."""
    out = np.zeros(3)
    noise_thresholds(1e-4, 25.0, 0.01, _settings(fast=Parallel(25.0, 2.0, 4.0, 6.0)).parallel, out)
    assert out == pytest.approx([2 * 0.5e-4, 4 * 0.5e-4 * 25.0, 6 * 0.5e-4 * 625.0])


def test_in_calm_it_stays_with_the_slow_observer() -> None:
    rng = np.random.default_rng(4)
    z, settings = _at_rest(), _settings()
    gates, disturbances = [], []
    for _ in range(1000):
        _step(z[0], NOISE_M * rng.standard_normal(3), settings)
        gates.append(float(z[0].gate))
        disturbances.append(float(z[0].dist_lab_m_s2[0]))
    assert np.mean(gates) < 0.02
    assert np.std(disturbances) < 0.05


def test_a_push_is_believed_within_five_frames_and_known_within_ten() -> None:
    """5 m/s^2 along x; y, which is not pushed, stays where it is but for noise."""
    rng = np.random.default_rng(5)
    z, settings = _at_rest(), _settings()
    for _ in range(100):
        _step(z[0], NOISE_M * rng.standard_normal(3), settings)
    gates, estimates = [], []
    for k in range(1, 11):
        truth = np.array([2.5 * (k * DT_S) ** 2, 0.0, 0.0])
        _step(z[0], truth + NOISE_M * rng.standard_normal(3), settings)
        gates.append(float(z[0].gate))
        estimates.append(z[0].dist_lab_m_s2[:2].copy())
    assert max(gates[:5]) > 0.9
    assert estimates[-1][0] == pytest.approx(5.0, rel=0.2)
    assert abs(estimates[-1][1]) < 1.5


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


def test_one_gate_makes_it_the_same_in_every_direction() -> None:
    """A push at 45 degrees is estimated as the same push along x, turned."""
    quarter, settings = np.sqrt(0.5), _settings(ObserverGains(8.0, 0.0, 0.004), Parallel(90.0))
    along, across = _at_rest(), _at_rest()
    for k in range(1, 12):
        x = 2.0 * (k * DT_S) ** 2
        _step(along[0], np.array([x, 0.0, 0.0]), settings)
        _step(across[0], np.array([quarter * x, quarter * x, 0.0]), settings)
    assert across[0].gate == pytest.approx(float(along[0].gate))
    assert across[0].dist_lab_m_s2[:2] == pytest.approx(quarter * along[0].dist_lab_m_s2[0], rel=1e-9)

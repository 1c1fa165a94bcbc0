"""One axis's observer between quiet and noisy cameras, seen and unseen."""

import numpy as np
import pytest

from formation.estimation.observers import height_gain
from formation.estimation.response import no_history, remember
from formation.estimation.settings import ObserverGains, ObserverSettings
from formation.estimation.state import VehicleEstimate
from formation.estimation.update import model_acceleration, observe_axis
from formation.maths.records import blank
from formation.paper.eq34_observer import fteso_step
from tests.formation.oracles.estimator import begun
from tests.formation.oracles.estimator import height_gain as height_gain_by_hand

DT_S, MODEL, MEASURED = 0.01, 0.7, 0.002
UPRIGHT = np.array([1.0, 0.0, 0.0, 0.0])


def _settings() -> ObserverSettings:
    settings = blank(ObserverSettings, 1)[0]
    settings.quiet_m = 2e-4
    for gains, w in ((settings.horizontal, 11.0), (settings.vertical, 15.0)):
        gains.bandwidth_rad_s, gains.alpha, gains.scale, gains.smooth = w, -0.1, 0.004, 1.0
    return settings


def _observed(commanded_index: int, axis: int, noise_m: float, gain: float) -> tuple[float, float, float]:
    z: VehicleEstimate = blank(VehicleEstimate, 1)[0]
    z.noise.var_m2, z.adaptive_gain = noise_m * noise_m, gain
    settings = _settings()
    settings.commanded_index = commanded_index
    observe_axis(z, axis, MEASURED, True, MODEL, DT_S, settings)
    return float(z.pos_lab_m[axis]), float(z.vel_lab_m_s[axis]), float(z.dist_lab_m_s2[axis])


def _with(gains: ObserverGains) -> tuple[float, float, float]:
    w, alpha, scale, smooth = gains.bandwidth_rad_s, gains.alpha, gains.scale, gains.smooth
    return fteso_step(0.0, 0.0, 0.0, MODEL, MEASURED, DT_S, w, alpha, scale, smooth)


@pytest.mark.parametrize(("commanded_index", "axis", "noise_m", "gain", "w_rad_s"), [
    (0, 0, 1e-4, 1.0, 11.0),  # quieter than quiet_m: as it is
    (0, 0, 8e-4, 1.0, 11.0 * 4.0 ** (-1.0 / 3.0)),  # four times the quiet noise
    (-1, 1, 2e-4, 3.0, 11.0 * 3.0),  # only observed: the adaptive gain
    (0, 2, 8e-4, 3.0, 15.0 * 4.0 ** (-1.0 / 3.0)),  # a commanded vehicle's is not widened
])  # fmt: skip
def test_the_bandwidth_shrinks_with_noise_and_grows_with_the_adaptive_gain(
    commanded_index: int, axis: int, noise_m: float, gain: float, w_rad_s: float
) -> None:
    assert _observed(commanded_index, axis, noise_m, gain) == pytest.approx(
        _with(ObserverGains(w_rad_s, -0.1, 0.004)), rel=1e-12
    )


def test_unseen_it_is_newtons_law() -> None:
    z: VehicleEstimate = blank(VehicleEstimate, 1)[0]
    z.pos_lab_m[0], z.vel_lab_m_s[0], z.dist_lab_m_s2[0], z.noise.var_m2 = 1.0, 2.0, 0.5, 1e-8
    observe_axis(z, 0, 99.0, False, 1.5, 0.1, _settings())
    assert (z.pos_lab_m[0], z.vel_lab_m_s[0], z.dist_lab_m_s2[0]) == pytest.approx((1.21, 2.2, 0.5))


def test_the_model_is_thrust_and_gravity_less_the_drag_of_a_vehicle_that_moves() -> None:
    """f(x) of Eq. (4): a hover at (2, -1, 0.5) m/s with 0.5 and 0.2 1/s is slowed by (1, -0.5, 0.1) m/s^2."""
    settings, model, t_ns = _settings(), np.zeros(3), 10**9
    settings.commanded_index, settings.drag_1_s[:] = 0, (0.5, 0.5, 0.2)
    settings.response.attitude_lag_s = settings.response.thrust_lag_s = 0.05
    settings.nominal_lag_s = 0.05
    z: VehicleEstimate = blank(VehicleEstimate, 1)[0]
    z.q_lab_from_flu[:], z.thrust_scale, z.thrust_m_s2, z.specific_force_lab_m_s2[2] = UPRIGHT, 1.0, 9.8, 9.8
    z.vel_lab_m_s[:] = (2.0, -1.0, 0.5)
    hover = remember(no_history(1), 0, np.array([[0.0, 0.0, 9.8, 9.8]]))
    model_acceleration(z, t_ns, t_ns + 10_000_000, True, True, settings, hover, model)
    assert model == pytest.approx([-1.0, 0.5, -0.1], abs=1e-12)


def _falling(acc_m_s2: float, noise_m: float, seconds: float) -> tuple[VehicleEstimate, list[float], list[float]]:
    """The height of a vehicle whose acceleration the model misses; every gain, by the oracle the same, and velocity."""
    rng = np.random.default_rng(3)
    z: VehicleEstimate = blank(VehicleEstimate, 1)[0]
    z.noise.var_m2 = max(noise_m, 1e-4) ** 2
    settings, twin, gains, velocities = _settings(), begun(0, np.zeros(3), UPRIGHT, False, True), [], []
    settings.vertical.bandwidth_rad_s, twin.noise_m2 = 5.0, float(z.noise.var_m2)
    for k in range(1, round(seconds / DT_S) + 1):
        measured = 0.5 * acc_m_s2 * (k * DT_S) ** 2 + noise_m * rng.standard_normal()
        twin.pos[2], twin.vel[2], twin.dist[2] = z.pos_lab_m[2], z.vel_lab_m_s[2], z.dist_lab_m_s2[2]
        gains.append(height_gain_by_hand(twin, measured, 0.0, DT_S))
        before = z.copy()
        observe_axis(z, 2, measured, True, 0.0, DT_S, settings)
        assert height_gain(before, measured, 0.0, DT_S) == pytest.approx(gains[-1], rel=1e-12)
        velocities.append(float(z.vel_lab_m_s[2]))
    return z, gains, velocities


def test_a_height_that_the_thrust_does_not_explain_is_observed_faster() -> None:
    """A third of the thrust is lost: at the pace that is right in calm, the fall was taken for two thirds of itself."""
    _, gains, velocities = _falling(-3.4, 1e-4, 0.6)
    assert 2.0 < max(gains) <= 3.0
    assert velocities[-1] == pytest.approx(-3.4 * 0.6, abs=0.3)
    z: VehicleEstimate = blank(VehicleEstimate, 1)[0]
    calm = ObserverGains(5.0, -0.1, 0.004)
    for k in range(1, 61):
        z.pos_lab_m[2], z.vel_lab_m_s[2], z.dist_lab_m_s2[2] = fteso_step(
            z.pos_lab_m[2], z.vel_lab_m_s[2], z.dist_lab_m_s2[2], 0.0, -1.7 * (k * DT_S) ** 2, DT_S, 5.0, calm.alpha,
            calm.scale, calm.smooth,
        )  # fmt: skip
    assert abs(z.vel_lab_m_s[2] + 3.4 * 0.6) > 0.6


@pytest.mark.parametrize(("acc_m_s2", "noise_m"), [(0.3, 1e-4), (0.0, 0.005), (0.0, 0.03)])
def test_neither_a_little_mass_nor_noise_makes_a_height_be_observed_faster(acc_m_s2: float, noise_m: float) -> None:
    assert set(_falling(acc_m_s2, noise_m, 1.0)[1]) == {1.0}

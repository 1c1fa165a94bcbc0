"""One axis's observer between quiet and noisy cameras, seen and unseen."""

import numpy as np
import pytest

from formation.estimation.heading import observe_heading
from formation.estimation.observers import filter_innovation, height_gain
from formation.estimation.response import no_history, remember
from formation.estimation.settings import ObserverGains, ObserverSettings
from formation.estimation.state import VehicleEstimate
from formation.estimation.update import model_acceleration, observe_axis, rebuild_force
from formation.maths.records import blank
from formation.paper.eq34_observer import fteso_step

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
    z.thrust_scale = 1.1
    model_acceleration(z, t_ns, t_ns + 10_000_000, True, True, settings, hover, model)
    assert model == pytest.approx([-1.0, 0.5, 0.98 - 0.1], abs=1e-12)


def _falling(acc_m_s2: float, noise_m: float, seconds: float) -> tuple[VehicleEstimate, list[float], list[float]]:
    """The height of a vehicle whose acceleration the model misses; every gain and velocity."""
    rng = np.random.default_rng(3)
    z: VehicleEstimate = blank(VehicleEstimate, 1)[0]
    z.noise.var_m2 = max(noise_m, 1e-4) ** 2
    settings, gains, velocities = _settings(), [], []
    settings.vertical.bandwidth_rad_s = 5.0
    for k in range(1, round(seconds / DT_S) + 1):
        measured = 0.5 * acc_m_s2 * (k * DT_S) ** 2 + noise_m * rng.standard_normal()
        gains.append(height_gain(z.copy(), measured, 0.0, DT_S))
        observe_axis(z, 2, measured, True, 0.0, DT_S, settings)
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


@pytest.mark.parametrize(("fast_weight", "trust"), [(0.0, 0.2), (0.5, 0.4), (1.0, 0.6)])
def test_the_force_lies_between_what_was_sent_and_what_the_attitude_shows(fast_weight: float, trust: float) -> None:
    """Sent 1 and -2 m/s^2 sideways for long, and a thrust of 10; seen leaning by 0.3 rad, 0.1 m/s^2 of it bias."""
    settings, t_ns = _settings(), 2 * 10**9
    settings.commanded_index, settings.attitude_trust, settings.parallel.attitude_trust = 0, 0.2, 0.6
    settings.response.attitude_lag_s, settings.response.thrust_lag_s = 0.05, 0.04
    z: VehicleEstimate = blank(VehicleEstimate, 1)[0]
    z.fast.weight, z.model_error.level_bias_m_s2[:] = fast_weight, (0.1, 0.0)
    z.q_lab_from_flu[:] = np.cos(0.15), 0.0, np.sin(0.15), 0.0
    sent = remember(no_history(1), 0, np.array([[1.0, -2.0, 9.0, 10.0]]))
    rebuild_force(z, 10**9, t_ns, True, settings, sent[0])
    shown = 10.0 * np.array([np.sin(0.3), 0.0, np.cos(0.3)]) - [0.1, 0.0, 0.0]
    expected = [*((1.0 - trust) * np.array([1.0, -2.0]) + trust * shown[:2]), shown[2]]
    assert z.specific_force_lab_m_s2 == pytest.approx(expected)
    rebuild_force(z, t_ns, t_ns + 10**9, False, settings, sent[0])  # unseen: as sent
    assert z.specific_force_lab_m_s2 == pytest.approx([1.0, -2.0, 9.0])


def test_what_moves_as_the_model_and_z3_say_leaves_no_innovation() -> None:
    """In 0.1 s: 1 + 0.1 * 2 + 0.005 (0.7 + 0.5); a heading that is not seen goes on by the turn asked for, too."""
    z: VehicleEstimate = blank(VehicleEstimate, 1)[0]
    z.pos_lab_m[1], z.vel_lab_m_s[1], z.dist_lab_m_s2[1] = 1.0, 2.0, 0.5
    assert filter_innovation(z, 1, 1.206, 0.7, 0.1, 1.0) == pytest.approx(0.0, abs=1e-15)
    heading = z.heading
    heading.yaw_rad, heading.rate_rad_s, heading.dist_rad_s2, heading.acc_command_rad_s2 = 1.0, 2.0, 0.5, 0.7
    observe_heading(z, False, 0.1, _settings())
    assert (heading.yaw_rad, heading.rate_rad_s, heading.dist_rad_s2) == pytest.approx((1.206, 2.07, 0.0))

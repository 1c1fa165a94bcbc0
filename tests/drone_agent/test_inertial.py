"""What the simulated accelerometer and gyroscope show, and when they are told of."""

import numpy as np
import pytest

from drone_agent.flight.vehicle import ImuSample
from drone_agent.guard.position import LoopSetpoint
from drone_agent.simulation.airframe import Airframe
from drone_agent.simulation.disturbance import Disturbance
from drone_agent.simulation.inertial import InertialError, InertialSensor
from formation.maths.arrays import Float
from formation.maths.frames import from_rotation_vector, inverse, rotate
from formation.vehicle.body import GRAVITY_M_S2
from formation.vehicle.profile import VehicleState, at_rest, profile
from tests.drone_agent.agent_harness import LEVEL, MS, Harness, S, hover_over
from wire.link_messages import InertialSample, Result

INTERVAL, HIGHRES_IMU = 511, 105.0
NO_BIAS = (0.0, 0.0, 0.0)
QUIET = InertialError(noise_m_s2=0.0, vibration_m_s2=0.0, rate_noise_rad_s=0.0, bias_flu_m_s2=NO_BIAS)
UP_G = [0.0, 0.0, GRAVITY_M_S2]
DRAGLESS = profile("paper_40g").model_copy(update={"drag_n_s_m": NO_BIAS, "ground_effect": 0.0})


class Believer:
    """An autopilot whose attitude estimate is level for ever, or the truth it is told of."""

    def __init__(self) -> None:
        self.q_lab_from_flu = LEVEL.copy()

    def receive_sample(self, sample: ImuSample) -> Float:
        return self.q_lab_from_flu

    def receive_fix(self, t_ns: int, pos_lab_m: Float, q_lab_from_flu: Float) -> None:
        self.q_lab_from_flu = q_lab_from_flu.copy()


def _frame(height_m: float, wind_m_s2: tuple[float, float, float] = NO_BIAS) -> Airframe:
    """A drone without drag, watched by sensors without noise."""
    start, air = np.array([0.0, 0.0, height_m]), Disturbance(wind_lab_m_s2=wind_m_s2)
    return Airframe(DRAGLESS, air, start, 0.0, 0, InertialSensor(QUIET, 1), Believer(), has_receiver=True)


def _shown(frame: Airframe, t_ns: int) -> Float:
    frame.advance_to(t_ns)
    assert frame.newest_sample is not None
    assert frame.newest_sample.t_ns == frame.t_ns
    return frame.newest_sample.specific_force_flu_m_s2


def _turned(axis: tuple[float, float, float], t_s: float, vel_lab_m_s: Float) -> VehicleState:
    """A body that turns at a constant rate from level, at a velocity."""
    state = at_rest(np.zeros(3), from_rotation_vector(np.array(axis) * t_s))
    state.vel_lab_m_s[:], state.rate_flu_rad_s[:] = vel_lab_m_s, axis
    return state


def test_nothing_is_felt_in_free_fall_but_the_wind() -> None:
    np.testing.assert_allclose(_shown(_frame(50.0), S), 0.0, atol=1e-9)
    np.testing.assert_allclose(_shown(_frame(50.0, (0.3, -0.2, 0.1)), S), [0.3, -0.2, 0.1], atol=1e-9)


def test_thrust_is_felt_along_the_bodys_own_up_however_it_leans() -> None:
    frame = _frame(50.0)
    frame.armed = True
    lean = from_rotation_vector(np.array([0.2, -0.1, 0.5]))
    frame.order_now(LoopSetpoint(lean, np.zeros(3), DRAGLESS.thrust_norm_of(1.3 * DRAGLESS.weight_n)))
    np.testing.assert_allclose(_shown(frame, 3 * S), [0.0, 0.0, 1.3 * GRAVITY_M_S2], atol=1e-3)


def test_what_a_turning_body_shows_is_the_mean_in_its_own_axes() -> None:
    """Ten rad/s: the axes turn by 3 degrees within a sample, which shows 0.25 m/s^2 if it is taken at the end."""
    axis = (6.0, -8.0, 0.0)
    force_lab = np.array([1.0, -2.0, 12.0])
    ends = (_turned(axis, t_s, (force_lab - UP_G) * t_s) for t_s in (0.0, 0.005))
    sample = InertialSensor(QUIET, 1).sample(*ends, 5 * MS, 0.005)
    times = (np.arange(1000) + 0.5) * 5e-6
    each = [rotate(inverse(from_rotation_vector(np.array(axis) * t)), force_lab) for t in times]
    np.testing.assert_allclose(sample.specific_force_flu_m_s2, np.mean(each, axis=0), atol=2e-3)
    np.testing.assert_allclose(sample.rate_flu_rad_s, axis)


def _errors(error: InertialError, sysid: int, count: int = 4000) -> Float:
    """(count, 6) What it shows of a body at rest, less what it should."""
    sensor, rest = InertialSensor(error, sysid), at_rest(np.zeros(3), LEVEL)
    return np.array([sensor.sample(rest, rest, k, 0.005).values - [*UP_G, 0.0, 0.0, 0.0] for k in range(count)])


def test_the_noise_is_white_as_large_as_asked_and_determined_by_its_seed() -> None:
    error = QUIET.model_copy(update={"noise_m_s2": 0.3, "rate_noise_rad_s": 0.02})
    noise = _errors(error, 1)
    assert noise.std(axis=0) == pytest.approx([0.3] * 3 + [0.02] * 3, rel=0.06)
    assert np.abs(noise.mean(axis=0) / noise.std(axis=0)).max() < 4.0 / np.sqrt(4000)
    assert np.abs(np.corrcoef(noise[1:].T, noise[:-1].T) - np.eye(12)).max() < 0.1
    np.testing.assert_array_equal(_errors(error, 1, 9), noise[:9])
    for other in (_errors(error, 2, 9), _errors(error.model_copy(update={"seed": 1}), 1, 9)):
        assert not np.isclose(other, noise[:9]).any()


def test_the_bias_is_in_the_bodys_axes() -> None:
    bias = {"bias_flu_m_s2": (0.3, -0.2, 0.1), "rate_bias_flu_rad_s": (0.01, 0.0, -0.02)}
    np.testing.assert_allclose(_errors(QUIET.model_copy(update=bias), 1, 3), [[0.3, -0.2, 0.1, 0.01, 0.0, -0.02]] * 3)


@pytest.mark.parametrize("rate_hz", [50.0, 100.0, 200.0])
def test_it_comes_as_often_as_asked_until_it_is_switched_off(rate_hz: float) -> None:
    harness = Harness()
    harness.run(1.0)
    assert harness.command(INTERVAL, HIGHRES_IMU, 1e6 / rate_hz) is Result.ACCEPTED
    harness.heard.clear()
    harness.run(2.0)
    heard = [(t_ns, m) for t_ns, m in harness.heard if isinstance(m, InertialSample)]
    assert len(heard) == pytest.approx(2.0 * rate_hz, abs=2)
    assert np.diff([m.t_boot_us for _, m in heard]) == pytest.approx(1e6 / rate_hz)
    assert all(0 <= t_ns // 1000 - m.t_boot_us < 5000 for t_ns, m in heard)
    assert harness.command(INTERVAL, HIGHRES_IMU, -1.0) is Result.ACCEPTED
    harness.heard.clear()
    harness.run(1.0)
    assert not harness.of(InertialSample)


def test_a_flight_is_the_same_to_the_bit_whether_it_is_watched_or_not() -> None:
    air = Disturbance(wind_lab_m_s2=(0.2, 0.0, 0.0), fan={"pos_lab_m": (0.5, 0.0, 0.5)})
    flown = []
    for rates in ({}, {105: 200.0}):
        harness = Harness(rates_hz=rates, disturbance=air)
        harness.fly_offboard()
        harness.run(2.0, hover_over(0.2, -0.1, 0.7))
        flown.append(harness)
    assert [bool(harness.of(InertialSample)) for harness in flown] == [False, True]
    still, watched = (harness.airframe.state.x for harness in flown)
    assert flown[0].airframe.t_ns == flown[1].airframe.t_ns
    np.testing.assert_array_equal(still, watched)

"""What the simulated accelerometer and gyroscope show, and when they are told of."""

import numpy as np
import pytest
from pydantic import ValidationError

from drone_agent.simulation.airframe import Airframe
from drone_agent.simulation.attitude_loop import LoopSetpoint
from drone_agent.simulation.disturbance import Disturbance
from drone_agent.simulation.inertial import WINDOW_NS, InertialError, InertialSensor
from formation.maths.arrays import Float
from formation.maths.frames import from_rotation_vector, inverse, rotate
from formation.vehicle.profile import GRAVITY_M_S2, VehicleState, at_rest, profile
from tests.drone_agent.agent_harness import LEVEL, MS, Harness, S, hover_at, hover_over
from wire.link_messages.commands import Result
from wire.link_messages.motion import InertialSample

INTERVAL, REQUEST, HIGHRES_IMU = 511, 512, 105.0
NO_BIAS = (0.0, 0.0, 0.0)
QUIET = InertialError(noise_m_s2=0.0)
UP_G = [0.0, 0.0, GRAVITY_M_S2]
DRAGLESS = profile("paper_40g").model_copy(update={"drag_n_s_m": NO_BIAS, "ground_effect": 0.0})


def _frame(height_m: float, wind_m_s2: tuple[float, float, float] = NO_BIAS) -> Airframe:
    """A drone without drag, watched by sensors without noise."""
    frame = Airframe(DRAGLESS, Disturbance(wind_lab_m_s2=wind_m_s2), np.array([0.0, 0.0, height_m]), 0.0, 0)
    frame.inertial = InertialSensor(QUIET, NO_BIAS, 1)
    return frame


def _shown(frame: Airframe, t_ns: int) -> Float:
    frame.advance_to(t_ns)
    assert frame.inertial is not None
    sample = frame.inertial.sample()
    assert sample is not None
    assert sample.t_ns == frame.t_ns
    return sample.specific_force_flu_m_s2


def _turned(axis: tuple[float, float, float], t_s: float, vel_lab_m_s: Float) -> VehicleState:
    """A body that turns at a constant rate from level, at a velocity."""
    state = at_rest(np.zeros(3), from_rotation_vector(np.array(axis) * t_s))
    state.vel_lab_m_s[:], state.rate_flu_rad_s[:] = vel_lab_m_s, axis
    return state


def test_the_floor_carries_what_stands_on_it() -> None:
    np.testing.assert_allclose(_shown(_frame(0.0), 2 * S), UP_G, atol=1e-6)


def test_nothing_is_felt_in_free_fall_but_the_wind() -> None:
    np.testing.assert_allclose(_shown(_frame(50.0), S), 0.0, atol=1e-9)
    np.testing.assert_allclose(_shown(_frame(50.0, (0.3, -0.2, 0.1)), S), [0.3, -0.2, 0.1], atol=1e-9)


def test_thrust_is_felt_along_the_bodys_own_up_however_it_leans() -> None:
    frame = _frame(50.0)
    frame.armed = True
    lean = from_rotation_vector(np.array([0.2, -0.1, 0.5]))
    frame.order_now(LoopSetpoint(lean, np.zeros(3), DRAGLESS.thrust_norm_of(1.3 * DRAGLESS.weight_n)))
    np.testing.assert_allclose(_shown(frame, 3 * S), [0.0, 0.0, 1.3 * GRAVITY_M_S2], atol=1e-3)


def test_a_sample_is_the_mean_over_the_last_five_milliseconds_and_stamped_at_their_end() -> None:
    sensor = InertialSensor(QUIET, NO_BIAS, 1)
    for ms, speed in enumerate([9.0, 0.0, 0.001, 0.004, 0.009, 0.016, 0.025]):  # the first is before they began
        sensor.note(ms * MS, _turned((0.0, 0.0, 0.0), 0.0, np.array([speed, 0.0, 0.0])))
    sample = sensor.sample()
    assert sample is not None
    assert sample.t_ns == 6 * MS
    np.testing.assert_allclose(sample.specific_force_flu_m_s2, [5.0, 0.0, GRAVITY_M_S2], atol=1e-9)


def test_there_is_none_before_a_whole_window_or_after_what_is_forgotten() -> None:
    sensor = InertialSensor(QUIET, NO_BIAS, 1)
    for ms in range(5):
        sensor.note(ms * MS, at_rest(np.zeros(3), LEVEL))
    assert sensor.sample() is None
    sensor.note(WINDOW_NS, at_rest(np.zeros(3), LEVEL))
    assert sensor.sample() is not None
    sensor.reset()
    assert sensor.sample() is None


def test_what_a_turning_body_shows_is_the_mean_in_its_own_axes() -> None:
    """Ten rad/s: the axes turn by 3 degrees within a sample, which shows 0.25 m/s^2 if it is taken at the end."""
    axis = (6.0, -8.0, 0.0)
    force_lab = np.array([1.0, -2.0, 12.0])
    sensor = InertialSensor(QUIET, NO_BIAS, 1)
    for ms in range(6):
        sensor.note(ms * MS, _turned(axis, ms * 1e-3, (force_lab - UP_G) * ms * 1e-3))
    sample = sensor.sample()
    assert sample is not None
    times = (np.arange(1000) + 0.5) * 5e-6
    each = [rotate(inverse(from_rotation_vector(np.array(axis) * t)), force_lab) for t in times]
    np.testing.assert_allclose(sample.specific_force_flu_m_s2, np.mean(each, axis=0), atol=2e-3)
    np.testing.assert_allclose(sample.rate_flu_rad_s, axis)


def _noise(error: InertialError, sysid: int, count: int = 2000) -> Float:
    sensor = InertialSensor(error, NO_BIAS, sysid)
    for ms in range(6):
        sensor.note(ms * MS, at_rest(np.zeros(3), LEVEL))
    samples = [sensor.sample() for _ in range(count)]
    return np.array([sample.specific_force_flu_m_s2 - UP_G for sample in samples if sample is not None])


def test_the_noise_is_white_as_large_as_asked_and_determined_by_its_seed() -> None:
    noise = _noise(InertialError(), 1)
    assert noise.shape == (2000, 3)
    assert noise.std(axis=0) == pytest.approx([0.3] * 3, rel=0.06)
    assert np.abs(noise.mean(axis=0)).max() < 4.0 * 0.3 / np.sqrt(2000)
    assert np.abs(np.corrcoef(noise[1:].T, noise[:-1].T) - np.eye(6)).max() < 0.1
    np.testing.assert_array_equal(_noise(InertialError(), 1, 9), noise[:9])
    for other in (_noise(InertialError(), 2, 9), _noise(InertialError(seed=1), 1, 9)):
        assert not np.isclose(other, noise[:9]).any()


def test_noise_of_a_negative_size_is_refused() -> None:
    with pytest.raises(ValidationError, match="noise_m_s2"):
        InertialError(noise_m_s2=-0.1)


def test_the_bias_is_that_of_the_dead_reckoning_in_the_labs_axes() -> None:
    harness = Harness(
        inertial_error=QUIET, accel_bias_lab_m_s2=(0.3, -0.2, 0.1), start_yaw_rad=np.pi / 2, rates_hz={105: 50.0}
    )
    harness.run(2.0)
    np.testing.assert_allclose(
        harness.last(InertialSample).specific_force_flu_m_s2, [-0.2, -0.3, 0.1 + GRAVITY_M_S2], atol=1e-5
    )


def test_nothing_is_sent_unless_it_is_asked_for() -> None:
    harness = Harness()
    harness.run(3.0)
    assert not harness.of(InertialSample)
    assert harness.autopilot.airframe.inertial is None  # and no step of the body is watched


def test_only_px4_has_it() -> None:
    assert Harness(autopilot="ardupilot").command(INTERVAL, HIGHRES_IMU, 20_000.0) is Result.DENIED


def test_a_single_one_is_sent_where_they_are_streamed_and_else_none() -> None:
    harness = Harness()
    harness.run(1.0)
    assert harness.command(REQUEST, HIGHRES_IMU) is Result.ACCEPTED
    assert not harness.of(InertialSample)
    harness.command(INTERVAL, HIGHRES_IMU, 1e6)
    harness.run(0.5)
    harness.heard.clear()
    harness.command(REQUEST, HIGHRES_IMU)
    assert len(harness.of(InertialSample)) == 1


@pytest.mark.parametrize("rate_hz", [50.0, 200.0, 250.0])
def test_it_comes_as_often_as_asked_until_it_is_switched_off(rate_hz: float) -> None:
    harness = Harness()
    harness.run(1.0)
    assert harness.command(INTERVAL, HIGHRES_IMU, 1e6 / rate_hz) is Result.ACCEPTED
    harness.heard.clear()
    harness.run(2.0)
    heard = [(t_ns, m) for t_ns, m in harness.heard if isinstance(m, InertialSample)]
    assert len(heard) == pytest.approx(2.0 * rate_hz, abs=2)
    assert np.diff([m.t_boot_us for _, m in heard]) == pytest.approx(1e6 / rate_hz)
    assert all(0 <= t_ns // 1000 - m.t_boot_us < 1000 for t_ns, m in heard)
    assert harness.command(INTERVAL, HIGHRES_IMU, -1.0) is Result.ACCEPTED
    harness.heard.clear()
    harness.run(1.0)
    assert not harness.of(InertialSample)
    assert harness.autopilot.airframe.inertial is None


def test_when_it_is_asked_for_again_nothing_of_the_time_between_is_in_it() -> None:
    harness = Harness(inertial_error=QUIET, accel_bias_lab_m_s2=NO_BIAS)
    harness.command(INTERVAL, HIGHRES_IMU, 4000.0)
    harness.run(0.5)
    harness.command(INTERVAL, HIGHRES_IMU, -1.0)
    harness.fly_offboard()
    harness.heard.clear()
    harness.command(INTERVAL, HIGHRES_IMU, 4000.0)
    harness.run(0.1, hover_at(0.5))
    assert harness.of(InertialSample)[0].t_boot_us > (harness.now_ns // 1000) - 150_000
    for sample in harness.of(InertialSample):
        np.testing.assert_allclose(sample.specific_force_flu_m_s2, UP_G, atol=0.5)


def test_in_flight_it_adds_up_to_the_change_of_velocity() -> None:
    harness = Harness(inertial_error=QUIET, accel_bias_lab_m_s2=NO_BIAS)
    harness.fly_offboard()
    harness.command(INTERVAL, HIGHRES_IMU, 5000.0)
    before, since_ns = harness.truth, harness.now_ns
    harness.heard.clear()
    q_lab_from_flu = [before.q_lab_from_flu]
    gained = np.zeros(3)
    stream = hover_over(0.5, 0.3, 0.8)
    for _ in range(60):
        harness.run(0.01, stream)
        q_lab_from_flu.append(harness.truth.q_lab_from_flu)
    samples = [m for m in harness.of(InertialSample) if m.t_boot_us * 1000 > since_ns]
    assert len(samples) == pytest.approx(120, abs=1)
    for k, sample in enumerate(samples):
        gained += 0.005 * (rotate(q_lab_from_flu[min(k // 2, 60)], sample.specific_force_flu_m_s2) - UP_G)
    moved = harness.truth.vel_lab_m_s - before.vel_lab_m_s
    assert np.linalg.norm(moved[:2]) > 0.2
    np.testing.assert_allclose(gained, moved, atol=0.05)


def test_a_flight_is_the_same_to_the_bit_whether_it_is_watched_or_not() -> None:
    air = Disturbance(wind_lab_m_s2=(0.2, 0.0, 0.0), fan={"pos_lab_m": (0.5, 0.0, 0.5)})
    flown = []
    for rates in ({}, {105: 250.0}):
        harness = Harness(rates_hz=rates, disturbance=air, level_error={"rms_rad": 0.005, "seed": 3})
        harness.fly_offboard()
        harness.run(2.0, hover_over(0.2, -0.1, 0.7))
        flown.append(harness)
    assert [bool(harness.of(InertialSample)) for harness in flown] == [False, True]
    still, watched = (harness.autopilot.airframe.state.x for harness in flown)
    assert flown[0].autopilot.airframe.t_ns == flown[1].autopilot.airframe.t_ns
    np.testing.assert_array_equal(still, watched)

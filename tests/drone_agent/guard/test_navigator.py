"""The navigator against true motion: what it says of its errors is what they are, and no input disturbs it."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import chi2

from drone_agent.guard.navigator import Navigator
from formation.maths.arrays import Float
from formation.maths.frames import IDENTITY, inverse, rotate
from formation.navigation.receive import Input, RejectReason
from formation.navigation.state import BIAS, DELAY, LEVEL
from tests.drone_agent.guard.guard_flights import MS, SIH, Flight, G, Motion, S, Streams, fly, navigator, sensed

ONE = np.array([0])
WHOLE_S = 0.01
"""Inertial samples that miss nothing between them, so that the truth's time is theirs."""


def errors(nav: Navigator, motion: Motion) -> tuple[Float, Float]:
    """True less estimated position and velocity (n, 6), and what the navigator says of them (n, 6, 6)."""
    out, cov = [], []
    for i in range(len(nav.bodies)):
        x = nav.bodies[i].estimate
        t = np.array(x.t_ns * 1e-9)
        out.append(np.concatenate([motion.pos(t)[i] - x.pos_lab_m, motion.vel(t)[i] - x.vel_lab_m_s]))
        cov.append(x.cov[:6, :6].copy())
    return np.array(out), np.array(cov)


@pytest.mark.parametrize("imu", [SIH, pytest.param((0.3, 0.3, 0.3), marks=pytest.mark.nightly)])
def test_errors_are_as_large_as_the_covariance_says(imu: tuple[float, float, float]) -> None:
    """NEES of the velocity and NIS of the position within the 99.9 % interval of chi-square over time.

    The position's NEES may be half as much more: samples of 10 ms are no more than steps of what happened between.
    """
    flight = Flight(n=20, seed=3, imu_m_s2=imu, gyro_rad_s=0.03, tilt_rad=0.0, imu_mean_s=WHOLE_S)
    motion = Motion(flight)
    nav = navigator(flight)
    pos, vel, nis = [], [], []

    def keep(j: int) -> None:
        if j >= 1000 and j % 250 == 0:
            error, cov = errors(nav, motion)
            for part, out in ((slice(0, 3), pos), (slice(3, 6), vel)):
                inverse_cov = np.linalg.inv(cov[:, part, part])
                out.append(np.einsum("ni,nij,nj->n", error[:, part], inverse_cov, error[:, part]))
            new = [nav.innovation(i, 0) for i in range(flight.n)]
            nis.append([np.sum(a.innovation**2 / a.innovation_variance) for a in new])

    assert fly(nav, sensed(motion, 20.1), keep) == []
    count = len(nis) * flight.n
    low, high = chi2.ppf([0.0005, 0.9995], 3 * count) / count
    assert low < np.mean(vel) < high
    assert low < np.mean(nis) < high
    assert low < np.mean(pos) < 1.5 * high


def test_biases_and_delay_are_found() -> None:
    flight = Flight(n=4, seed=1, vel_m_s=0.8, clock_s=0.012, tilt_rad=0.0, imu_mean_s=WHOLE_S, level_rad=0.0)
    motion, nav = Motion(flight), navigator(flight)
    assert fly(nav, sensed(motion, 30.0)) == []
    for i in range(flight.n):
        x = nav.bodies[i].estimate
        bias, level, delay = (np.sqrt(np.diag(x.cov)[k]) for k in (BIAS, LEVEL, DELAY))
        assert x.accel_bias_flu_m_s2 == pytest.approx(motion.bias[i], abs=4.0 * bias)
        assert x.pose_delay_s == pytest.approx(flight.clock_s, abs=4.0 * delay)
        assert x.level_bias_flu_rad == pytest.approx(np.zeros(3), abs=4.0 * level)
        assert bias < 0.06
        assert level < 0.01
        assert delay < 0.002


def test_dead_reckoning_drifts_as_computed_by_hand() -> None:
    """A second without poses, of bodies at rest, by SIH's accelerometer of s m/s^2 RMS at 100 Hz along each axis:
    position q T^3 / 3 and velocity q T, q = s^2 / 100 Hz; velocity and bias were known too well to add more than half.
    """
    flight = Flight(n=30, seed=5, vel_m_s=0.0, imu_m_s2=SIH, tilt_rad=0.0, bias_m_s2=0.2, yaw_rate_rad_s=0.0)
    motion, nav = Motion(flight), navigator(flight)
    streams = sensed(motion, 11.2)
    seen = replace(streams, pose_ns=streams.pose_ns[:1000], pos=streams.pos[:1000], q=streams.q[:1000])
    fly(nav, seen)
    which = np.arange(30)
    for k in np.flatnonzero((streams.imu_ns > seen.pose_ns[-1] + 10 * MS) & (streams.imu_ns <= 11 * S + 200 * MS)):
        nav.receive_imu(which, np.full(30, streams.imu_ns[k]), streams.force[k], streams.rate[k])
    at_ns = int(seen.pose_ns[-1]) + S
    there = [nav.predicted(i, at_ns) for i in range(30)]
    q = motion.q(np.array(1.0))
    pos = rotate(inverse(q), np.array([x.pos_lab_m for x in there]) - motion.pos(np.array(1.0)))
    vel = rotate(inverse(q), np.array([x.vel_lab_m_s for x in there]))
    density = np.square(SIH) / 100.0
    for error, by_hand in ((pos, np.sqrt(density / 3.0)), (vel, np.sqrt(density))):
        rms = np.sqrt(np.mean(error**2, axis=0))
        assert (rms[1:] > 0.75 * by_hand[1:]).all()
        assert (rms[1:] < 1.5 * by_hand[1:]).all()
        assert rms[0] < 3.0 * by_hand[0]
    said = np.sqrt(np.mean([np.trace(nav.bodies[i].estimate.cov[:3, :3]) for i in range(30)]))
    assert said == pytest.approx(np.sqrt(np.mean(np.sum(pos**2, axis=1))), rel=0.35)


def test_an_estimate_that_begins_anew_on_the_floor_knows_its_bias_as_well_as_before() -> None:
    """Else late poses in a take-off, which show less of the climb than there is, teach what is missing as a bias: it
    learned 0.7 m/s^2 in 0.2 s, and came down upwards."""
    nav, level = Navigator(), np.array([[1.0, 0.0, 0.0, 0.0]])
    force, rate = np.array([[0.0, 0.0, G + 0.1]]), np.zeros((1, 3))
    for k in range(1, 341):
        t_ns, missed_s = np.array([k * 10 * MS]), max(0.01 * k - 3.2, 0.0)
        if k == 320:
            nav.bodies[0].status.rejecting_ns = int(t_ns[0])
        if k <= 320:
            nav.reset_checks(0)
        nav.receive_imu(ONE, t_ns, force, rate)
        noise = 3e-4 * np.random.default_rng(k).standard_normal(3)
        nav.receive_pose(ONE, t_ns, (noise - [0.0, 0.0, 0.5 * 0.7 * missed_s**2])[None], level)
    assert nav.bodies[0].estimate.accel_bias_flu_m_s2[2] == pytest.approx(0.1, abs=0.1)


def test_an_attitude_may_come_before_the_sample_of_its_time() -> None:
    """A body that turns by several rad/s: its rate until then is in that sample, not in the one before."""
    flight = Flight(n=4, seed=3, vel_m_s=0.4, band_hz=(2.0, 3.0))
    streams = sensed(Motion(flight), 3.0)
    assert np.abs(streams.rate).max() > 8.0
    before, after = navigator(flight), navigator(flight)
    assert fly(before, streams, attitude_first=True) == fly(after, streams) == []
    # All but the first: without a sample yet, an attitude stands for one.
    for name in ("pos_lab_m", "vel_lab_m_s", "q_lab_from_flu", "pose_delay_s"):
        np.testing.assert_allclose(before.bodies["estimate"][name], after.bodies["estimate"][name], atol=1e-4)


def test_a_body_is_estimated_alike_alone_and_among_others() -> None:
    flight = Flight(n=3, seed=4)
    s = sensed(Motion(flight), 4.0)
    all_of_them, alone = navigator(flight), Navigator(1, pose_rate_hz=100)
    fly(all_of_them, s)
    one = Streams(s.imu_ns, s.force[:, 1:2], s.rate[:, 1:2], s.pose_ns, s.pos[:, 1:2], s.q[:, 1:2], s.attitude[:, 1:2])
    fly(alone, one)
    assert alone.bodies[0].tobytes() == all_of_them.bodies[1].tobytes()


def standing(seconds: float = 3.0) -> tuple[Navigator, int]:
    nav, rng = Navigator(1, pose_rate_hz=100), np.random.default_rng(0)
    for k in range(1, round(seconds * 100) + 1):
        t_ns = np.array([k * 10 * MS])
        force = np.array([[0.0, 0.0, G]]) + 0.1 * rng.standard_normal((1, 3))
        nav.receive_imu(ONE, t_ns, force, np.zeros((1, 3)))
        nav.receive_pose(ONE, t_ns, 0.0003 * rng.standard_normal((1, 3)), IDENTITY[None])
    return nav, k * 10 * MS


LEVEL_FORCE, ZERO = np.array([[0.0, 0.0, G]]), np.zeros((1, 3))


def test_each_input_that_is_none_is_rejected_with_its_reason() -> None:
    nav, t_ns = standing()
    next_ns, last_ns, future = np.array([t_ns + 5 * MS]), np.array([t_ns]), np.array([t_ns - S])
    before = nav.bodies["estimate"].tobytes()
    nan, huge = np.full((1, 3), np.nan), np.full((1, 3), 1e3)
    nav.receive_imu(ONE, next_ns, nan, ZERO)
    nav.receive_imu(ONE, next_ns, LEVEL_FORCE, nan)
    nav.receive_imu(ONE, next_ns, huge, ZERO)
    nav.receive_imu(ONE, last_ns, LEVEL_FORCE, ZERO)
    nav.receive_imu(ONE, future, LEVEL_FORCE, ZERO)
    nav.receive_pose(ONE, next_ns, nan, IDENTITY[None])
    nav.receive_pose(ONE, next_ns, ZERO, np.full((1, 4), np.inf))
    nav.receive_pose(ONE, next_ns, 10.0 * huge, IDENTITY[None])
    nav.receive_pose(ONE, next_ns, ZERO, np.zeros((1, 4)))
    nav.receive_pose(ONE, last_ns, ZERO, IDENTITY[None])
    nav.receive_pose(ONE, future, ZERO, IDENTITY[None])
    nav.receive_attitude(ONE, next_ns, np.full((1, 4), np.nan), ZERO)
    nav.receive_attitude(ONE, future, IDENTITY[None], ZERO)
    nav.receive_thrust(ONE, next_ns, np.array([1e9]))
    assert nav.bodies["estimate"].tobytes() == before
    reasons = RejectReason
    counts = nav.rejected[0]
    assert counts[Input.IMU, [reasons.NOT_FINITE, reasons.IMPOSSIBLE, reasons.OUT_OF_ORDER]].tolist() == [2, 1, 2]
    assert counts[Input.POSE, [reasons.NOT_FINITE, reasons.IMPOSSIBLE, reasons.OUT_OF_ORDER]].tolist() == [2, 2, 2]
    assert counts[Input.ATTITUDE, [reasons.NOT_FINITE, reasons.TOO_OLD]].tolist() == [1, 1]
    assert counts[Input.THRUST, reasons.IMPOSSIBLE] == 1


floats = st.floats(width=64)


@settings(max_examples=60, deadline=None)
@given(
    st.lists(
        st.tuples(st.sampled_from(list(Input)), st.integers(-300, 300), st.lists(floats, min_size=7, max_size=7)),
        max_size=20,
    )
)
def test_nothing_that_comes_breaks_the_estimate(inputs: list[tuple[Input, int, list[float]]]) -> None:
    """Whatever numbers at whatever times: the estimate stays finite, its covariance positive."""
    nav, t_ns = standing(0.3)
    for kind, ms, numbers in inputs:
        at, v = np.array([t_ns + ms * MS]), np.array([numbers])
        if kind is Input.IMU:
            nav.receive_imu(ONE, at, v[:, :3], v[:, 3:6])
        elif kind is Input.ATTITUDE:
            nav.receive_attitude(ONE, at, v[:, :4], v[:, 4:7])
        elif kind is Input.POSE:
            nav.receive_pose(ONE, at, v[:, :3], v[:, 3:7])
        else:
            nav.receive_thrust(ONE, at, v[:, 0])
    x = nav.bodies[0].estimate
    assert np.isfinite(x.pos_lab_m).all()
    assert np.linalg.norm(x.q_lab_from_flu) == pytest.approx(1.0)
    assert np.linalg.eigvalsh(x.cov).min() > 0.0

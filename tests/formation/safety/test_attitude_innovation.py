"""The mocap's attitudes against the drones' own: what is late or wrong shows, what clocks and markers do does not."""

import numpy as np
import pytest

from formation.control.limits.target import correct_level
from formation.maths import frames
from formation.messages import AttitudeTarget, LabFrame
from formation.safety.attitude_innovation import AttitudeMonitor, tilts

MS = 1_000_000


def test_a_roll_to_the_left_shows_gravity_to_its_side_and_who_is_not_seen_shows_nothing() -> None:
    """0.2 rad about x: sin 0.2 along y."""
    out = np.empty((2, 2))
    tilts(np.tile([np.cos(0.1), np.sin(0.1), 0.0, 0.0], (2, 1)), np.array([True, False]), out)
    assert out[0] == pytest.approx([0.0, np.sin(0.2)], abs=1e-15)
    assert np.isnan(out[1]).all()


def test_bodies_are_compared_each_with_its_own_whatever_the_order_of_their_attitudes() -> None:
    """The second leans by 0.02 rad about x: 0.02 along y, less two milliradians of doubt; the first not."""
    monitor, which = AttitudeMonitor(2), np.array([0, 1])
    lean = np.array([np.cos(0.01), np.sin(0.01), 0.0, 0.0])
    for k in range(200):
        stamp_ns, level = 10 * k * MS, np.tile(frames.IDENTITY, (2, 1))
        monitor.receive_frame(LabFrame(k, stamp_ns, ("a", "b"), np.zeros((2, 3)), level, np.ones(2, bool)))
        order = which if k % 3 else which[::-1]
        monitor.receive_attitudes(order, np.full(2, stamp_ns), np.array([level[0], lean])[order])
    assert monitor.level_bias_rad(which)[0].tolist() == [0.0, 0.0]
    assert monitor.level_bias_rad(which)[1] == pytest.approx([0.0, -(np.sin(0.02) - 2e-3)], abs=1e-6)


def receive(monitor: AttitudeMonitor, t_ns: int, q_lab_from_flu: np.ndarray) -> None:
    """One attitude of the first body."""
    monitor.receive_attitudes(np.array([0]), np.array([t_ns]), q_lab_from_flu[None])


SEEN = np.ones(1, bool)


def swaying(t_s: float, size_rad: float) -> np.ndarray:
    """About the body's y at 0.8 Hz, and turning about lab z all the while."""
    sway = size_rad * np.sin(2.0 * np.pi * 0.8 * t_s)
    return frames.multiply(frames.from_yaw(np.array(0.5 * t_s)), np.array([np.cos(sway / 2), 0, np.sin(sway / 2), 0]))


def watched(late_s: float, size_rad: float = 0.2, lies_rad: float = 0.0, clock_s: float = 0.0, seconds: float = 6.0):
    """The greatest miss over all that time; late_s: how much older than its stamp each pose is."""
    monitor, rng, most = AttitudeMonitor(1), np.random.default_rng(3), 0.0
    lies = np.array([np.cos(lies_rad / 2), np.sin(lies_rad / 2), 0.0, 0.0])
    for k in range(round(100 * seconds)):
        t_s = 0.01 * k
        small = frames.canonical(np.array([1.0, *(5e-4 * rng.standard_normal(3))]))
        q = frames.canonical(frames.multiply(frames.multiply(swaying(t_s - late_s, size_rad), lies), small))
        monitor.receive_frame(LabFrame(k, 10 * k * MS, ("a",), np.zeros((1, 3)), q[None], SEEN))
        if k % 2:  # the drone's own comes before the cameras'
            own_s = t_s + 0.004
            receive(monitor, round((own_s + clock_s) * 1e3) * MS, frames.canonical(swaying(own_s, size_rad)))
        most = max(most, float(monitor.innovation_rad[0]))
    return most


def test_what_agrees_misses_next_to_nothing():
    assert watched(0.0) < 0.01


def test_markers_that_lie_askew_are_no_innovation():
    assert watched(0.0, lies_rad=0.05) < 0.012


def test_clocks_that_are_ten_milliseconds_apart_are_no_innovation():
    """At a rate of a radian a second."""
    assert watched(0.0, clock_s=0.01) < 0.01
    assert watched(0.0, clock_s=-0.01) < 0.01


@pytest.mark.parametrize("late_s", [0.1, 0.2, 0.4])
def test_late_poses_are_an_innovation_of_the_rate_times_the_delay(late_s):
    """Of its effective value 0.03 s of the rate, 0.71 rad/s, are in doubt; twice its peak is reached at the most."""
    peak = 2.0 * 0.2 * np.sin(np.pi * 0.8 * late_s)
    assert peak / np.sqrt(2.0) - 0.03 * 0.71 < watched(late_s) < 2.0 * peak


def test_an_attitude_that_is_simply_wrong_is_an_innovation():
    assert watched(0.0, lies_rad=0.4, size_rad=0.0) > 0.2


def test_nothing_is_said_of_a_drone_that_is_not_seen_or_says_nothing():
    monitor = AttitudeMonitor(2)
    for k in range(100):
        q = np.tile(frames.IDENTITY, (2, 1))
        monitor.receive_frame(LabFrame(k, 10 * k * MS, ("a", "b"), np.zeros((2, 3)), q, np.array([False, True])))
        receive(monitor, 10 * k * MS, np.array([0.8, 0.6, 0.0, 0.0]))
    assert monitor.innovation_rad.tolist() == [0.0, 0.0]


def leaning(lean: np.ndarray, wanted: np.ndarray, sway_rad: float = 0.0, clock_s: float = 0.0) -> np.ndarray:
    """What is told to a drone whose own attitude is the true one, turned by `lean`, about lab axes; wanted: of it."""
    monitor = AttitudeMonitor(1)
    for k in range(200):
        t_s, s = 0.01 * k, 0.01 * k + clock_s
        true, own = (frames.multiply(wanted, swaying(at_s, sway_rad)) if sway_rad else wanted for at_s in (t_s, s))
        monitor.receive_frame(LabFrame(k, 10 * k * MS, ("a",), np.zeros((1, 3)), frames.canonical(true)[None], SEEN))
        receive(monitor, 10 * k * MS, frames.canonical(frames.multiply(lean, own)))
    target = AttitudeTarget(0, wanted[None], np.zeros((1, 3)), np.ones(1), np.zeros(1), np.zeros(1, np.bool_))
    return correct_level(target, monitor.level_bias_rad(np.array([0]))).q_lab_from_flu[0]


@pytest.mark.parametrize("axis", [(1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (-0.6, 0.8, 0.0)])
def test_the_target_of_a_drone_with_a_level_bias_is_corrected_by_it(axis):
    """It takes a true attitude q for L q, so that told L q it flies q; two milliradians of it are left to noise."""
    lean = frames.from_rotation_vector(0.02 * np.array(axis))
    for yaw_rad in (0.0, 2.0):
        wanted = frames.multiply(frames.from_yaw(np.array(yaw_rad)), frames.from_rotation_vector(np.array([0.1, 0, 0])))
        flown = frames.multiply(frames.inverse(lean), leaning(lean, wanted))
        off = frames.multiply(frames.inverse(wanted), flown)
        assert 2.0 * np.linalg.norm(off[1:3]) < 0.003


def test_the_target_of_a_drone_without_level_bias_is_unchanged_to_the_bit():
    wanted = frames.from_rotation_vector(np.array([0.1, -0.2, 0.3]))
    assert np.array_equal(leaning(frames.IDENTITY, wanted), wanted)
    assert np.array_equal(leaning(frames.from_rotation_vector(np.array([0.0015, 0.0, 0.0])), wanted), wanted)


def test_what_clocks_make_of_a_turn_is_no_level_bias():
    assert np.array_equal(leaning(frames.IDENTITY, frames.IDENTITY, sway_rad=0.3, clock_s=0.01), frames.IDENTITY)


def test_a_level_bias_is_followed_within_bounds():
    """Three degrees; more is markers that lie askew, or worse."""
    told = leaning(frames.from_rotation_vector(np.array([0.3, 0.0, 0.0])), frames.IDENTITY)
    assert 2.0 * told[1] == pytest.approx(0.05, rel=1e-3)

"""Two witnesses of one attitude: what differs while a drone turns is time, what differs always is how markers lie."""

import numpy as np
import pytest

from formation.maths import frames
from formation.messages import LabFrame
from gcs.drones.attitude_witness import AttitudeWitness

MS = 1_000_000
SEEN = np.ones(1, bool)


def swaying(t_s: float, size_rad: float) -> np.ndarray:
    """About the body's y at 0.8 Hz, and turning about lab z all the while."""
    sway = size_rad * np.sin(2.0 * np.pi * 0.8 * t_s)
    return frames.multiply(frames.from_yaw(np.array(0.5 * t_s)), np.array([np.cos(sway / 2), 0, np.sin(sway / 2), 0]))


def watched(late_s: float, size_rad: float = 0.2, lies_rad: float = 0.0, clock_s: float = 0.0, seconds: float = 6.0):
    """The greatest miss over all that time; late_s: how much older than its stamp each pose is."""
    witness, rng, most = AttitudeWitness(1), np.random.default_rng(3), 0.0
    lies = np.array([np.cos(lies_rad / 2), np.sin(lies_rad / 2), 0.0, 0.0])
    for k in range(round(100 * seconds)):
        t_s = 0.01 * k
        small = frames.canonical(np.array([1.0, *(5e-4 * rng.standard_normal(3))]))
        q = frames.canonical(frames.multiply(frames.multiply(swaying(t_s - late_s, size_rad), lies), small))
        witness.see(LabFrame(k, 10 * k * MS, ("a",), np.zeros((1, 3)), q[None], SEEN))
        if k % 2:  # the drone's own comes before the cameras'
            own_s = t_s + 0.004
            witness.hear(0, round((own_s + clock_s) * 1e3) * MS, frames.canonical(swaying(own_s, size_rad)))
        most = max(most, float(witness.miss_rad[0]))
    return most


def test_what_agrees_misses_next_to_nothing():
    assert watched(0.0) < 0.01


def test_markers_that_lie_askew_are_no_miss():
    assert watched(0.0, lies_rad=0.05) < 0.012


def test_clocks_that_are_ten_milliseconds_apart_are_no_miss():
    """At a rate of a radian a second."""
    assert watched(0.0, clock_s=0.01) < 0.01
    assert watched(0.0, clock_s=-0.01) < 0.01


@pytest.mark.parametrize("late_s", [0.1, 0.2, 0.4])
def test_late_poses_are_a_miss_of_the_rate_times_the_delay(late_s):
    """Of its effective value 0.03 s of the rate, 0.71 rad/s, are in doubt; twice its peak is reached at the most."""
    peak = 2.0 * 0.2 * np.sin(np.pi * 0.8 * late_s)
    assert peak / np.sqrt(2.0) - 0.03 * 0.71 < watched(late_s) < 2.0 * peak


def test_an_attitude_that_is_simply_wrong_is_a_miss():
    assert watched(0.0, lies_rad=0.4, size_rad=0.0) > 0.2


def test_nothing_is_said_of_a_drone_that_is_not_seen_or_says_nothing():
    witness = AttitudeWitness(2)
    for k in range(100):
        q = np.tile(frames.IDENTITY, (2, 1))
        witness.see(LabFrame(k, 10 * k * MS, ("a", "b"), np.zeros((2, 3)), q, np.array([False, True])))
        witness.hear(0, 10 * k * MS, np.array([0.8, 0.6, 0.0, 0.0]))
    assert witness.miss_rad.tolist() == [0.0, 0.0]


def leaning(lean: np.ndarray, wanted: np.ndarray, sway_rad: float = 0.0, clock_s: float = 0.0) -> np.ndarray:
    """What is told to a drone whose own attitude is the true one, turned by `lean`, about lab axes; wanted: of it."""
    witness = AttitudeWitness(1)
    for k in range(200):
        t_s, s = 0.01 * k, 0.01 * k + clock_s
        true, own = (frames.multiply(wanted, swaying(at_s, sway_rad)) if sway_rad else wanted for at_s in (t_s, s))
        witness.see(LabFrame(k, 10 * k * MS, ("a",), np.zeros((1, 3)), frames.canonical(true)[None], SEEN))
        witness.hear(0, 10 * k * MS, frames.canonical(frames.multiply(lean, own)))
    return witness.told(0, wanted)


@pytest.mark.parametrize("axis", [(1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (-0.6, 0.8, 0.0)])
def test_a_drone_that_leans_is_told_so_much_more_that_it_flies_what_is_wanted(axis):
    """It takes a true attitude q for L q, so that told L q it flies q; two milliradians of it are left to noise."""
    lean = frames.from_rotation_vector(0.02 * np.array(axis))
    for yaw_rad in (0.0, 2.0):
        wanted = frames.multiply(frames.from_yaw(np.array(yaw_rad)), frames.from_rotation_vector(np.array([0.1, 0, 0])))
        flown = frames.multiply(frames.inverse(lean), leaning(lean, wanted))
        off = frames.multiply(frames.inverse(wanted), flown)
        assert 2.0 * np.linalg.norm(off[1:3]) < 0.003


def test_a_drone_that_is_level_is_told_what_is_wanted_to_the_bit():
    wanted = frames.from_rotation_vector(np.array([0.1, -0.2, 0.3]))
    assert np.array_equal(leaning(frames.IDENTITY, wanted), wanted)
    assert np.array_equal(leaning(frames.from_rotation_vector(np.array([0.0015, 0.0, 0.0])), wanted), wanted)


def test_what_clocks_make_of_a_turn_is_no_lean():
    assert np.array_equal(leaning(frames.IDENTITY, frames.IDENTITY, sway_rad=0.3, clock_s=0.01), frames.IDENTITY)


def test_a_lean_is_followed_within_bounds():
    """Three degrees; more is markers that lie askew, or worse."""
    told = leaning(frames.from_rotation_vector(np.array([0.3, 0.0, 0.0])), frames.IDENTITY)
    assert 2.0 * told[1] == pytest.approx(0.05, rel=1e-3)

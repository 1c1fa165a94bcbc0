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

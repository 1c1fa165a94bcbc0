"""Sequence numbers of one sender and of two; the mocap's attitude against the drone's own."""

import math
import random

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from formation.control.limits.target import correct_level
from formation.maths import frames
from formation.messages import AttitudeTarget, LabFrame
from gcs.drones.telemetry import AttitudeMonitor, SequenceMonitor, SpecificForce

MS = 1_000_000


def _heard(numbers, spacing_ns=10 * MS) -> SequenceMonitor:
    watch = SequenceMonitor()
    for i, number in enumerate(numbers):
        watch.note(number % 256, i * spacing_ns)
    return watch


def _force_means(phase_ns: int, missing: int = 0) -> list[float]:
    """Means over 10 ms of a force of 3 m/s^2 that vibrates by 2, sampled at 200 Hz; so many samples are missing."""
    force, means = SpecificForce(), []
    for k in range(1, 41):
        value = 3.0 + (2.0 if k % 2 else -2.0)
        force.receive(5 * k * MS, np.array([value, 0.0, 9.8]), 5 * k * MS)
        if k % 2 == 0 and k > 2:
            mean = force.pop_mean((5 * k + missing * 5) * MS - phase_ns)
            means.append(math.nan if mean is None else float(mean[0]))
    return means[1:]


@pytest.mark.parametrize("phase_ns", [0, 1, 700_000, 2_500_000, 4_999_999])
@pytest.mark.parametrize("missing", [0, 1])
def test_a_vibration_cancels_in_the_mean_force_however_samples_lie_between_frames(phase_ns, missing):
    np.testing.assert_allclose(_force_means(phase_ns, missing), 3.0, atol=1e-9)


def test_a_sample_counts_by_its_share_of_the_step():
    """From 6 to 16 ms: 4 ms of a force of 1, 5 of 2, 1 of 5 m/s^2."""
    force = SpecificForce()
    for t_ms, value in ((5, 0.0), (10, 1.0), (15, 2.0), (20, 5.0)):
        force.receive(t_ms * MS, np.array([value, 0.0, 0.0]), t_ms * MS)
    force.pop_mean(6 * MS)
    np.testing.assert_allclose(force.pop_mean(16 * MS), [(4 * 1.0 + 5 * 2.0 + 1 * 5.0) / 10.0, 0.0, 0.0])


def test_samples_further_apart_than_they_last_leave_steps_without_a_force():
    force = SpecificForce()
    for t_ms in (10, 110):
        force.receive(t_ms * MS, np.array([1.0, 0.0, 0.0]), t_ms * MS)
    force.pop_mean(50 * MS)
    assert force.pop_mean(60 * MS) is None
    assert force.pop_mean(100 * MS) is None
    np.testing.assert_allclose(force.pop_mean(110 * MS), [1.0, 0.0, 0.0])


def test_a_whole_stream_has_no_loss_and_wraps():
    watch = _heard(range(1000))
    assert (watch.received, watch.lost, watch.loss) == (1000, 0, 0.0)


def test_lost_packets_are_counted():
    watch = _heard([0, 1, 4, 5, 10])
    assert watch.lost == 2 + 4
    assert watch.loss == 6 / 11


def test_packets_addressed_to_others_are_not_lost():
    watch = SequenceMonitor()
    watch.note(10, 0)
    watch.note(13, MS, skipped=2)
    watch.note(14, 2 * MS, skipped=2)  # in one datagram with two of another's after it
    watch.note(17, 3 * MS)
    assert watch.lost == 0


def test_an_overtaken_packet_is_neither_lost_nor_a_lap():
    watch = _heard([5, 7, 6, 8, 9])
    assert watch.lost == 0
    assert not watch.duplicate(0)


def test_a_restarted_drone_is_no_duplicate():
    assert not _heard([*range(100, 140), *range(200)]).duplicate(240 * 10 * MS)


def test_two_senders_in_turns_are_noticed_and_forgotten_when_one_leaves():
    numbers = [n for i in range(20) for n in (i, 100 + i)]
    watch = _heard(numbers)
    now_ns = len(numbers) * 10 * MS
    assert watch.duplicate(now_ns)
    assert not watch.duplicate(now_ns + 3_000 * MS)


@given(start_a=st.integers(0, 255), gap=st.integers(0, 255), seed=st.integers(0, 1000))
def test_two_senders_at_any_rates_are_noticed(start_a, gap, seed):
    rng = random.Random(seed)
    counters, numbers = [start_a, start_a + gap], []
    for _ in range(300):
        k = rng.randrange(2)
        numbers.append(counters[k])
        counters[k] += 1
    watch = SequenceMonitor()
    noticed = False
    for i, number in enumerate(numbers):
        watch.note(number % 256, i * 10 * MS)
        noticed = noticed or watch.duplicate(i * 10 * MS)
    assert noticed


def test_twins_that_count_alike_are_noticed():
    assert _heard([n for i in range(100) for n in (i, i)]).duplicate(200 * 10 * MS)
    assert _heard([n for i in range(100) for n in (i + 2, i)]).duplicate(200 * 10 * MS)


@given(share=st.floats(0.0, 1.0), loss=st.floats(0.0, 0.5), seed=st.integers(0, 1000))
def test_a_network_that_overtakes_however_often_makes_no_twin(share, loss, seed):
    rng = random.Random(seed)
    sent = [number for number in range(1000) if rng.random() >= loss]
    numbers = sorted(sent, key=lambda number: number + rng.uniform(0.0, 4.0) * (rng.random() < share))
    watch = SequenceMonitor()
    for i, number in enumerate(numbers):
        watch.note(number % 256, i * 10 * MS)
        assert not watch.duplicate(i * 10 * MS)
    assert abs(watch.loss - loss) < 0.1


@given(loss=st.floats(0.0, 0.9), seed=st.integers(0, 1000))
def test_a_lone_sender_is_never_taken_for_two_whatever_is_lost(loss, seed):
    rng = random.Random(seed)
    watch = SequenceMonitor()
    for number in range(2000):
        if rng.random() >= loss:
            watch.note(number % 256, number * 10 * MS)
            assert not watch.duplicate(number * 10 * MS)


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
            monitor.receive_attitude(0, round((own_s + clock_s) * 1e3) * MS, frames.canonical(swaying(own_s, size_rad)))
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
        monitor.receive_attitude(0, 10 * k * MS, np.array([0.8, 0.6, 0.0, 0.0]))
    assert monitor.innovation_rad.tolist() == [0.0, 0.0]


def leaning(lean: np.ndarray, wanted: np.ndarray, sway_rad: float = 0.0, clock_s: float = 0.0) -> np.ndarray:
    """What is told to a drone whose own attitude is the true one, turned by `lean`, about lab axes; wanted: of it."""
    monitor = AttitudeMonitor(1)
    for k in range(200):
        t_s, s = 0.01 * k, 0.01 * k + clock_s
        true, own = (frames.multiply(wanted, swaying(at_s, sway_rad)) if sway_rad else wanted for at_s in (t_s, s))
        monitor.receive_frame(LabFrame(k, 10 * k * MS, ("a",), np.zeros((1, 3)), frames.canonical(true)[None], SEEN))
        monitor.receive_attitude(0, 10 * k * MS, frames.canonical(frames.multiply(lean, own)))
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

"""When frames were exposed, as the whole session tells it, against the truth of a lockstep."""

import numpy as np
import pytest

from sim.cameras.servers.natnet import NatNetSettings
from tests.mocap.sources.natnet_lockstep import MS, Lockstep

SERVER_CLOCKS = [NatNetSettings(), NatNetSettings(version=(3, 0), clock_hz=3_312_787, clock_s=-999.0)]
"""Two hours ahead; and one that has the frequency of a recorded session, and was started later than ours."""


def jittery(seed: int):
    """0.2 ms and an exponential jitter of 5 ms in the mean, each packet its own."""
    rng = np.random.default_rng(seed)
    return lambda: 0.0002 + rng.exponential(0.005)


@pytest.mark.parametrize(("seed", "settings"), [(1, SERVER_CLOCKS[0]), (2, SERVER_CLOCKS[0]), (3, SERVER_CLOCKS[1])])
def test_capture_time_is_within_1_ms_under_jitter_and_bursts(seed, settings):
    link = Lockstep(settings=settings, delay=jittery(seed))
    link.burst = 10
    link.run(1.0)
    since_ns = link.recorder.now_ns
    link.run(10.0)
    errors = np.abs(link.errors_ns(since_ns))
    assert len(errors) > 980
    assert np.percentile(errors, 99) < 1 * MS
    status = link.session.status()
    assert status.latency_measured
    assert status.uncertainty_s is not None
    assert 0.0 < status.uncertainty_s < 0.002


def test_without_jitter_it_is_exact_at_once():
    link = Lockstep()
    link.run(0.5)
    since_ns = link.recorder.now_ns
    link.run(1.0)
    errors = link.errors_ns(since_ns)
    assert len(errors) == 100
    assert max(map(abs, errors)) < 0.02 * MS


@pytest.mark.parametrize("hour", [3600, -3600])
def test_a_clock_that_was_set_by_an_hour_is_followed_by_the_next_echo(hour):
    link = Lockstep(delay=jittery(4))
    link.run(5.0)
    assert link.responder is not None
    link.responder.clock_step_ns = hour * 10**9
    link.run(0.2)
    assert "the server's clock was set" in link.recorder.texts
    link.run(4.8)
    since_ns = link.recorder.now_ns
    link.run(5.0)
    assert np.percentile(np.abs(link.errors_ns(since_ns)), 99) < 2 * MS


def test_no_capture_time_is_in_the_future_or_older_than_a_second_whatever_the_clock_does():
    link = Lockstep(delay=jittery(5))
    for step in (0, 10**12, -5 * 10**12, 3 * MS, -40 * MS):
        assert link.responder is not None
        link.responder.clock_step_ns = step
        link.run(1.0)
    ages = [now_ns - frame.t_capture_ns for now_ns, frame in link.recorder.frames]
    assert len(ages) > 300
    assert min(ages) >= 0
    assert max(ages) < 1000 * MS


def test_cameras_that_report_no_exposure_give_arrival_less_the_latency():
    link = Lockstep(settings=NatNetSettings(stamps=False), delay=jittery(6))
    link.run(3.0)
    assert link.recorder.frames
    assert all(now_ns - frame.t_capture_ns == 8 * MS for now_ns, frame in link.recorder.frames)
    assert not link.session.status().latency_measured

"""Capture times against the exposures a simulated server truly made: jitter, bursts, stalls, drift, stepped clocks."""

from dataclasses import dataclass

import numpy as np
import pytest

from formation.maths.arrays import Float
from mocap.capture_time import CaptureTime

RATE_HZ, LATENCY_S, LENGTH_S = 100.0, 0.004, 60.0
ANOTHER_ZONE_S = 7200.0
STEP_AT_S = 30.0


@dataclass(frozen=True, slots=True)
class Setup:
    """A server's clock and the network to us; seconds."""

    drift: float = 0.0
    jitter_s: float = 0.005
    burst: int = 1
    step_s: float = 0.0
    echoes: bool = False

    def theirs(self, t_s: Float) -> Float:
        """Their clock at our time."""
        return t_s * (1.0 + self.drift) + ANOTHER_ZONE_S + np.where(t_s > STEP_AT_S, self.step_s, 0.0)


def errors(setup: Setup, seed: int) -> tuple[Float, Float]:
    """When each frame came, s, and how far its capture time was off, s."""
    rng = np.random.default_rng(seed)
    exposed = np.arange(round(LENGTH_S * RATE_HZ)) / RATE_HZ
    arrived = exposed + LATENCY_S + rng.exponential(setup.jitter_s, len(exposed))
    for first in range(0, len(exposed), setup.burst):
        these = slice(first, first + setup.burst)
        arrived[these] = arrived[these][-1] + 50e-6 * np.arange(len(arrived[these]))
    for stall in (12.0, 40.0):
        arrived[(arrived > stall) & (arrived < stall + 0.36)] = stall + 0.36
    arrived = np.maximum.accumulate(arrived)
    asked = np.arange(0.0, LENGTH_S, 0.1) if setup.echoes else np.zeros(0)
    answered = asked + 2e-4 + rng.exponential(setup.jitter_s, len(asked))
    received = answered + 2e-4 + rng.exponential(setup.jitter_s, len(asked))
    stamps, echoes = setup.theirs(exposed), setup.theirs(answered)
    capture, off = CaptureTime(round(LATENCY_S * 1e9)), np.zeros(len(exposed))
    happening = sorted([(t, 0, i) for i, t in enumerate(arrived)] + [(t, 1, i) for i, t in enumerate(received)])
    for t_s, kind, i in happening:
        now_ns = round(t_s * 1e9)
        if kind == 1:
            capture.exchange(round(asked[i] * 1e9), round(echoes[i] * 1e9), now_ns)
        else:
            off[i] = capture.capture_ns(round(stamps[i] * 1e9), now_ns) * 1e-9 - exposed[i]
    return arrived, off


def p99_ms(off_s: Float) -> float:
    return float(np.percentile(np.abs(off_s), 99.0)) * 1e3


@pytest.mark.parametrize("drift", [80e-6, -80e-6])
def test_jitter_and_stalls_do_not_move_captures_by_a_millisecond_after_the_first_second(drift: float) -> None:
    arrived, off = errors(Setup(drift=drift), 1)
    assert p99_ms(off[arrived > 1.0]) < 1.0


def test_echoes_give_the_exposure_itself_even_of_bursts() -> None:
    arrived, off = errors(Setup(drift=-50e-6, burst=10, echoes=True), 1)
    assert p99_ms(off[arrived > 1.0]) < 1.0
    assert abs(np.median(off[arrived > 5.0])) < 2e-4


@pytest.mark.parametrize("step_s", [3600.0, -3600.0])
@pytest.mark.parametrize("echoes", [False, True])
def test_a_clock_set_by_an_hour_is_followed_within_five_seconds(step_s: float, echoes: bool) -> None:
    arrived, off = errors(Setup(drift=20e-6, step_s=step_s, echoes=echoes), 3)
    after = arrived > STEP_AT_S + 5.0
    assert np.abs(off[after]).max() < 2e-3
    assert np.abs(off[(arrived > 5.0) & (arrived < STEP_AT_S)]).max() < 2e-3


def test_a_capture_is_never_in_the_future_and_the_doubt_is_reported() -> None:
    """A request sent at 0, answered at their 1,000,000, heard at 400: theirs minus ours is 1,000,000 - 200 +- 200."""
    capture = CaptureTime(0)
    capture.exchange(0, 1_000_000, 400)
    assert (capture.offset_ns(400), capture.uncertainty_ns(400)) == (200 - 1_000_000, 200)
    capture = CaptureTime(0)
    assert capture.uncertainty_ns(0) is None
    for k in range(300):
        now_ns = k * 10_000_000 + (k % 7) * 300_000
        assert capture.capture_ns(k * 10_000_000 - 10**15, now_ns) <= now_ns
    assert 0 <= (capture.uncertainty_ns(now_ns) or 0) < 1_000_000

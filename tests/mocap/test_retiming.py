"""Re-timed captures against the exposures of simulated cameras: bursts, stalls, lost frames, set clocks."""

from dataclasses import dataclass

import numpy as np
import pytest

from formation.maths.arrays import Float
from mocap.retiming import WINDOW, Retiming, exposures_ns

LATENCY_S, IN_BURST_S = 0.004, 0.0004
S = 10**9


@dataclass(frozen=True, slots=True)
class Stream:
    """Cameras and the network behind them; seconds.

    stalled_share: of the stalls, those that hold frames back; the others lose them. is_numbered: by the cameras; else
    by what receives the frames. step_s: by how much the clock that stamps is set at half time.
    """

    rate_hz: float = 100.0
    jitter_s: float = 0.001
    stalls_s: tuple[float, ...] = (0.03, 0.05, 0.1, 0.2, 0.36, 0.87)
    stalled_share: float = 1.0
    is_numbered: bool = True
    step_s: float = 0.0
    length_s: float = 30.0

    def frames(self, seed: int) -> tuple[Float, Float, Float]:
        """Exposure, arrival and number of each frame that comes."""
        rng = np.random.default_rng(seed)
        exposed = np.arange(round(self.length_s * self.rate_hz)) / self.rate_hz
        arrived = exposed + LATENCY_S + rng.exponential(self.jitter_s, len(exposed))
        came = np.ones(len(exposed), np.bool_)
        start_s = 0.5
        while self.stalls_s and start_s < self.length_s:
            end_s = start_s + rng.choice(self.stalls_s)
            inside = (exposed >= start_s) & (exposed < end_s)
            if rng.random() < self.stalled_share:
                arrived[inside] = np.maximum(arrived[inside], end_s)
            else:
                came &= ~inside
            start_s = end_s + 0.5 + rng.exponential(0.5)
        number = np.flatnonzero(came) if self.is_numbered else np.arange(came.sum())
        exposed, arrived = exposed[came], arrived[came]
        for k in range(1, len(arrived)):
            arrived[k] = max(arrived[k], arrived[k - 1] + IN_BURST_S)
        return exposed, arrived, number


def errors_s(stream: Stream, seed: int, is_stamped: bool = True) -> tuple[Float, Float, Retiming]:
    """When each frame was exposed, and by how much more than the least delay it is re-timed after that."""
    exposed, arrived, number = stream.frames(seed)
    stamps = arrived + np.where(exposed > stream.length_s / 2, stream.step_s, 0.0)
    retiming, out = Retiming(), np.zeros(len(exposed))
    for k in range(len(exposed)):
        stamp_ns = 10**12 + round(stamps[k] * S)
        capture_ns = retiming.capture_ns(int(number[k]), stamp_ns, is_stamped)
        assert capture_ns is not None
        assert capture_ns <= stamp_ns
        out[k] = (capture_ns - 10**12) / S - exposed[k] - LATENCY_S
    return exposed, out, retiming


@pytest.mark.parametrize(
    ("rate_hz", "stalled_share", "is_stamped"), [(30, 0.5, True), (100, 1.0, False), (240, 0.5, True)]
)
def test_numbered_frames_get_their_exposures_back(rate_hz: float, stalled_share: float, is_stamped: bool) -> None:
    """Stamps on arrival are wrong by up to 0.87 s; what is left is the least of the jitter."""
    exposed, off_s, retiming = errors_s(Stream(rate_hz=rate_hz, stalled_share=stalled_share), 1, is_stamped)
    known = exposed > 4.0 * WINDOW / rate_hz
    assert np.abs(off_s[known]).max() < 0.003
    assert np.std(off_s[known]) < 0.001
    assert retiming.scatter_ns is not None
    assert retiming.scatter_ns < 2_000_000


def test_lost_frames_that_no_number_shows_cost_three_frames_each_time() -> None:
    exposed, off_s, _ = errors_s(Stream(stalled_share=0.5, is_numbered=False, length_s=60.0), 1)
    known = exposed > 8.0
    gaps = int((np.diff(exposed[known]) > 0.015).sum())
    assert gaps > 10
    assert np.abs(off_s[known] > 0.003).mean() < 0.01
    assert (off_s[known] < -0.003).sum() <= 3 * gaps


def test_true_stamps_are_left_as_they_are() -> None:
    """Bursts on the network say nothing of frames that are stamped when they are exposed."""
    retiming = Retiming()
    rng = np.random.default_rng(1)
    stamps = [10**12 + 10_000_000 * k + round(500_000 * rng.standard_normal()) for k in range(5000) if k % 700 > 60]
    assert [retiming.capture_ns(k, t_ns, True) for k, t_ns in enumerate(stamps)] == stamps
    assert retiming.scatter_ns is None
    steady_ns = np.arange(1000) * 10_000_000 + rng.integers(0, 2_000_000, 1000)
    assert exposures_ns(steady_ns) is steady_ns


@pytest.mark.parametrize("is_stamped", [True, False])
@pytest.mark.parametrize("waited", [60, 100, 120, 180])
def test_frames_that_waited_for_a_process_to_begin_are_no_rhythm(waited: int, is_stamped: bool) -> None:
    """Their spacings are those of a loop that hands them on: every later frame was exposed at the beginning."""
    for seed in range(20):
        handed_on_ns = np.random.default_rng(seed).lognormal(7.3, 0.8, waited)
        stamps_ns = np.cumsum(np.append(handed_on_ns, np.full(600, 20_000_000))).astype(np.int64).tolist()
        retiming = Retiming(is_numbered=False)
        captured_ns = [retiming.capture_ns(k, stamp_ns, is_stamped) for k, stamp_ns in enumerate(stamps_ns)]
        assert captured_ns[-100:] == pytest.approx(stamps_ns[-100:], rel=0.0, abs=1_000_000)


@pytest.mark.parametrize("step_s", [0.1, -3.0])
def test_a_clock_that_is_set_is_followed_within_five_seconds(step_s: float) -> None:
    stream = Stream(step_s=step_s, stalls_s=(0.05, 0.1), length_s=40.0)
    exposed, off_s, _ = errors_s(stream, 1)
    assert np.abs(off_s[exposed > 26.0] - step_s).max() < 0.003
    assert np.abs(off_s[(exposed > 8.0) & (exposed < 19.0)]).max() < 0.003


def test_a_source_that_numbers_by_its_stamps_is_counted_frame_by_frame() -> None:
    """VRPN numbers no frames: what held-back frames seem to have lost must not count."""
    exposed, arrived, _ = Stream().frames(1)
    retiming, off_s = Retiming(is_numbered=False), []
    for k in range(len(exposed)):
        seq = round(arrived[k] * 100.0)
        capture_ns = retiming.capture_ns(seq, round(arrived[k] * S), True)
        assert capture_ns is not None
        off_s.append(capture_ns / S - exposed[k] - LATENCY_S)
    assert np.abs(np.array(off_s)[exposed > 8.0]).max() < 0.003


@pytest.mark.parametrize("stalled_share", [1.0, 0.5])
def test_a_whole_recording_without_numbers_is_re_timed(stalled_share: float) -> None:
    exposed, arrived, _ = Stream(stalled_share=stalled_share, is_numbered=False, length_s=60.0).frames(1)
    stamps_ns = np.round(arrived * S).astype(np.int64)
    found_ns = exposures_ns(stamps_ns)
    assert (found_ns <= stamps_ns).all()
    off_s = found_ns[200:] / S - exposed[200:] - LATENCY_S
    assert (np.abs(off_s) > 0.004).mean() < 0.01
    assert np.std(off_s) < 0.3 * np.std(arrived[200:] - exposed[200:])

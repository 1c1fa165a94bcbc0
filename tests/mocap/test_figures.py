"""The figures of a stream against ones that were put into it by hand."""

import numpy as np
import pytest

from formation.maths import frames
from formation.messages import LabFrame
from mocap.figures import FrameWindow, as_json, timing

PERIOD_NS, DELAY_NS = 10_000_000, 8_000_000


def frame(seq: int, t_ns: int, x_m: float, seen: bool = True, yaw_rad: float = 0.0) -> LabFrame:
    pos = np.array([[x_m, 1.0, 2.0], [0.0, 0.0, 0.0]])
    q = np.array([frames.from_yaw(np.array(yaw_rad)), [1.0, 0.0, 0.0, 0.0]])
    return LabFrame(seq, t_ns, ("a", "b"), pos, q, np.array([seen, False]), t_ns + DELAY_NS)


def test_timing_is_of_exposures_and_counts_what_is_missing() -> None:
    """Ten periods of 10 ms, of which three frames never came."""
    numbers = np.array([0, 1, 2, 4, 5, 8, 9, 10])
    captured = numbers * PERIOD_NS
    found = timing(captured, captured + DELAY_NS, numbers)
    assert found.rate_hz == pytest.approx(100.0)
    assert found.lost_share == pytest.approx(0.3)
    assert found.delay_s == pytest.approx(0.008)
    assert found.gap_s == pytest.approx(0.03)
    assert found.jitter_s == pytest.approx(np.std([0.01, 0.01, 0.02, 0.01, 0.03, 0.01, 0.01]))


@pytest.mark.parametrize(("late_s", "arrival_stamps"), [(0.0005, False), (0.02, True)])
def test_frames_that_are_stamped_in_bursts_are_stamped_on_arrival(late_s: float, arrival_stamps: bool) -> None:
    """A network that holds one frame in ten back by 20 ms lets those behind it arrive with it."""
    numbers = np.arange(200)
    arrived = numbers * PERIOD_NS + np.where(numbers % 10 == 0, round(late_s * 1e9), 0)
    assert timing(np.maximum.accumulate(arrived), arrived, numbers).arrival_stamps is arrival_stamps


def test_exposures_that_jitter_are_not_stamped_on_arrival() -> None:
    """By an eighth of the period of 240 Hz: of 100 windows, some have three spacings under half of it by chance."""
    rng, numbers = np.random.default_rng(1), np.arange(201)
    for _ in range(100):
        exposed = np.round((numbers / 240.0 + 0.0005 * rng.standard_normal(201)) * 1e9).astype(np.int64)
        assert not timing(exposed, exposed + DELAY_NS, numbers).arrival_stamps


def test_a_window_tells_of_each_body_and_forgets_after_two_seconds() -> None:
    window = FrameWindow(("a", "b"))
    for k in range(700):
        window.add(frame(k, k * PERIOD_NS, 0.5 + 1e-4 * (-1) ** k, seen=k % 10 != 0, yaw_rad=1.25))
    now_ns = 699 * PERIOD_NS + DELAY_NS
    found = window.timing(now_ns)
    assert found is not None
    assert (found.rate_hz, found.lost_share) == (pytest.approx(100.0), 0.0)
    a, b = window.bodies(now_ns)
    assert a.seen_share == pytest.approx(0.9, abs=0.01)
    assert a.gap_s == pytest.approx(0.02)
    assert a.noise_m == pytest.approx(1e-4, rel=0.02)
    assert a.pos_lab_m == (0.5 - 1e-4, 1.0, 2.0)
    assert a.yaw_rad == pytest.approx(1.25)
    assert (b.seen_share, b.pos_lab_m, b.noise_m) == (0.0, None, None)
    late_ns = now_ns + 3_000_000_000
    assert window.timing(late_ns) is None
    assert as_json(window, late_ns)["timing"] is None
    assert window.bodies(late_ns)[0].pos_lab_m is None

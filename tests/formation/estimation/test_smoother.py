"""The smoother against disturbances that are known."""

import numpy as np
import pytest

from formation.estimation.smoother import smooth
from formation.maths.arrays import Float

NOISE_M = 1e-4
T_S = np.arange(0.0, 20.0, 0.01) + 0.001 * np.sin(np.arange(2000))
"""100 Hz, with jitter."""


def moved(hz: float, seed: int) -> tuple[Float, Float]:
    """Positions (T,) with noise under 2 m/s^2 sin(2 pi hz t) from rest, by hand, and that push."""
    w = 2.0 * np.pi * hz
    push = 2.0 * np.sin(w * T_S)
    pos = 2.0 / w * (T_S - np.sin(w * T_S) / w)
    return pos + NOISE_M * np.random.default_rng(seed).standard_normal(len(T_S)), push


def found(pos: Float, seen: Float | None = None, acc: float = 0.0) -> tuple[Float, float]:
    visible = np.ones_like(pos, np.bool_) if seen is None else seen.astype(np.bool_)
    explained = np.full((1, len(pos) - 1), acc)
    smoothed = smooth(T_S, pos[None], visible[None], explained, np.array([NOISE_M]))
    return smoothed.dist_m_s2[0], float(smoothed.known_hz[0])


@pytest.mark.parametrize("hz", [0.2, 1.0, 3.0])
def test_a_push_within_the_band_is_found_without_lag(hz: float) -> None:
    pos, push = moved(hz, 1)
    dist, known_hz = found(pos)
    assert known_hz > hz
    inside = slice(100, -100)
    assert np.sqrt(np.mean((dist - push)[inside] ** 2)) < 0.2
    late = np.sqrt(np.mean((dist[105:-100] - push[100:-105]) ** 2))
    assert late > np.sqrt(np.mean((dist - push)[inside] ** 2))


def test_above_the_band_little_of_a_push_is_found() -> None:
    """60 Hz moves it by 14 micrometres, a seventh of the noise."""
    pos, push = moved(40.0, 2)
    dist, known_hz = found(pos)
    assert known_hz < 40.0
    assert np.sqrt(np.mean(dist[100:-100] ** 2)) < 0.5 * np.sqrt(np.mean(push**2))


def test_what_the_model_explains_is_no_disturbance() -> None:
    pos = 0.25 * T_S**2
    dist, _ = found(pos, acc=0.5)
    assert np.abs(dist[100:-100]).max() < 0.01


def test_frames_that_do_not_show_the_body_count_for_nothing() -> None:
    pos, push = moved(0.2, 3)
    seen = np.ones_like(pos)
    seen[500:520] = 0.0
    pos[500:520] = 100.0
    dist, _ = found(pos, seen)
    assert np.sqrt(np.mean((dist - push)[100:-100] ** 2)) < 0.15

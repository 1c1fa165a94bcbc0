"""The heading of a leader that is only observed: quiet at rest, fast as soon as it turns, and while it does."""

import numpy as np
import pytest

from formation.control.presets import DEFAULT
from formation.estimation.heading import observe_heading
from formation.estimation.parallel import open_gate
from formation.estimation.settings import ObserverGains, ObserverSettings, Parallel
from formation.estimation.state import VehicleEstimate
from formation.maths import frames
from formation.maths.arrays import Float
from formation.maths.records import Rows, blank

DT_S, NOISE_RAD = 0.01, 1e-3
T_S = np.arange(1, 400) * DT_S


def _settings() -> ObserverSettings:
    settings = blank(ObserverSettings, 1)[0]
    settings.place, settings.quiet_rad = -1, DEFAULT.quiet_rad
    for name in ObserverGains.__slots__:
        setattr(settings.heading, name, getattr(DEFAULT.seen_heading_observer, name))
    for name in Parallel.__slots__:
        setattr(settings.heading_parallel, name, getattr(DEFAULT.seen_heading_parallel, name))
    return settings


def _observed(yaw_rad: Float, seed: int, unseen: slice = slice(0)) -> tuple[Rows[VehicleEstimate], Float]:
    """The estimate after all of these headings, each seen with noise; and yaw, rate, Z3, gate (T, 4) on the way."""
    z, settings, rng = blank(VehicleEstimate, 1), _settings(), np.random.default_rng(seed)
    seen = np.ones(len(yaw_rad), dtype=bool)
    seen[unseen] = False
    course = np.empty((len(yaw_rad), 4))
    for k, yaw in enumerate(yaw_rad):
        z["q_lab_from_flu"][0] = frames.from_yaw(yaw + NOISE_RAD * rng.standard_normal())
        observe_heading(z[0], bool(seen[k]), DT_S, settings)
        course[k] = z[0].yaw_rad, z[0].yaw_rate_rad_s, z[0].yaw_dist_rad_s2, open_gate(z[0].yaw_ratio)
    return z, course


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_at_rest_noise_neither_opens_the_gate_nor_turns_the_followers(seed: int) -> None:
    """A rate of 5 mrad/s is 3 mm/s at an arm of 0.6 m."""
    _, course = _observed(np.zeros(len(T_S)), seed)
    assert np.max(course[100:, 3]) < 0.3
    assert np.std(course[100:, 1]) < 5e-3


def test_a_turn_that_begins_is_known_within_a_tenth_of_a_second() -> None:
    """4 rad/s^2 from rest on: after 0.1 s the rate is 0.4 rad/s."""
    begins = 100
    yaw = 2.0 * np.maximum(np.arange(len(T_S)) - begins, 0) ** 2 * DT_S**2
    _, course = _observed(yaw, 4)
    after = begins + 10
    assert course[after, 3] > 0.9
    assert course[after, 1] == pytest.approx(4.0 * 10 * DT_S, rel=0.15)


def test_to_and_fro_it_stays_fast_where_the_turn_reverses() -> None:
    """0.5 rad at 0.5 Hz, as a hand turns a leader: nowhere does the estimate go back to the slow observer."""
    yaw = 0.5 * np.sin(np.pi * T_S)
    _, course = _observed(yaw, 5)
    assert np.min(course[100:, 3]) > 0.95
    late_s = np.abs(course[100:, 1] - 0.5 * np.pi * np.cos(np.pi * T_S[100:])).max() / (0.5 * np.pi**2)
    assert late_s < 0.03


def test_unseen_it_goes_on_turning_and_is_found_again_without_a_jump() -> None:
    yaw = 1.0 * T_S
    _, course = _observed(yaw, 6, unseen=slice(200, 220))
    assert np.abs(course[200:, 0] - yaw[200:]).max() < 0.02
    assert course[200:220, 2] == pytest.approx(0.0)
    assert np.abs(course[200:, 1] - 1.0).max() < 0.2


def test_a_heading_that_passes_half_a_turn_is_unwrapped() -> None:
    _, course = _observed(2.0 * T_S, 7)
    assert course[-1, 0] == pytest.approx(2.0 * T_S[-1], abs=0.01)

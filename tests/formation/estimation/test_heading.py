"""A heading that is only observed: quiet at rest, quick where a turn begins, and no wobble is amplified."""

import numpy as np
import pytest

from formation.control.presets import DEFAULT
from formation.estimation.heading import observe_heading
from formation.estimation.settings import ObserverGains, ObserverSettings
from formation.estimation.state import VehicleEstimate
from formation.maths import frames
from formation.maths.arrays import Float
from formation.maths.records import blank

DT_S, NOISE_RAD, AHEAD_S = 0.01, 1e-3, 0.17
T_S = np.arange(1, 400) * DT_S


def _settings() -> ObserverSettings:
    settings = blank(ObserverSettings, 1)[0]
    settings.commanded_index, settings.ahead_s = -1, AHEAD_S
    for name in ObserverGains.__slots__:
        setattr(settings.heading, name, getattr(DEFAULT.seen_heading_observer, name))
    return settings


def _observed(yaw_rad: Float, seed: int, unseen: slice = slice(0), noise_rad: float = NOISE_RAD) -> Float:
    """(T, 3) Estimated yaw, rate and Z3 after each of these headings, seen with noise."""
    z, settings, rng = blank(VehicleEstimate, 1), _settings(), np.random.default_rng(seed)
    z["heading_bank"]["noise_rad2"] = NOISE_RAD**2
    seen = np.ones(len(yaw_rad), dtype=bool)
    seen[unseen] = False
    course = np.empty((len(yaw_rad), 3))
    for k, yaw in enumerate(yaw_rad):
        z["t_ns"] = round((k + 1) * DT_S * 1e9)
        z["q_lab_from_flu"][0] = frames.from_yaw(yaw + noise_rad * rng.standard_normal())
        observe_heading(z[0], bool(seen[k]), DT_S, settings)
        course[k] = z[0].heading.yaw_rad, z[0].heading.rate_rad_s, z[0].heading.dist_rad_s2
    return course


@pytest.mark.parametrize("seed", [1, 2, 3])
@pytest.mark.parametrize("noise_rad", [NOISE_RAD, 0.003, 0.01])
def test_at_rest_noise_does_not_turn_the_followers(noise_rad: float, seed: int) -> None:
    """A rate of 5 mrad/s is 3 mm/s at an arm of 0.6 m.

    0.3 mm at an arm of 30 mm are 10 mrad: taken for turns, they were 0.4 rad/s, and 20 degrees of tilt behind it.
    """
    course = _observed(np.zeros(len(T_S)), seed, noise_rad=noise_rad)
    assert np.std(course[200:, 1]) < 5.0 * noise_rad


def test_a_turn_that_begins_is_known_within_a_tenth_of_a_second() -> None:
    """4 rad/s^2 from rest on: after 0.1 s the rate is 0.4 rad/s."""
    begins = 100
    yaw = 2.0 * np.maximum(np.arange(len(T_S)) - begins, 0) ** 2 * DT_S**2
    course = _observed(yaw, 4)
    assert course[begins + 10, 1] == pytest.approx(4.0 * 10 * DT_S, rel=0.15)


def test_to_and_fro_it_stays_fast_where_the_turn_reverses() -> None:
    """0.5 rad at 0.5 Hz, as a hand turns a leader: nowhere does the estimate go back to the slow observer."""
    course = _observed(0.5 * np.sin(np.pi * T_S), 5)
    late_s = np.abs(course[100:, 1] - 0.5 * np.pi * np.cos(np.pi * T_S[100:])).max() / (0.5 * np.pi**2)
    assert late_s < 0.03


@pytest.mark.parametrize(("hz", "most"), [(0.4, 0.35), (0.7, 1.0), (1.0, 1.0), (1.5, 1.2), (2.0, 1.2)])
@pytest.mark.parametrize("noise_rad", [0.0, NOISE_RAD])
def test_a_wobble_is_foretold_or_left_alone(hz: float, most: float, noise_rad: float) -> None:
    """10 mrad RMS; the error of what is foretold for `AHEAD_S` later, over the wobble: 1 is as bad as no answer."""
    t_s = np.arange(1, 2000) * DT_S
    yaw = 0.01 * np.sqrt(2.0) * np.sin(2.0 * np.pi * hz * t_s)
    course, later = _observed(yaw, 8, noise_rad=noise_rad), round(AHEAD_S / DT_S)
    foretold = course[:, 0] + AHEAD_S * (course[:, 1] + 0.5 * AHEAD_S * course[:, 2])
    error = (foretold[:-later] - yaw[later:])[500:]
    smooth = np.convolve(error, np.ones(20) / 20, "valid")  # what a follower makes of noise
    assert np.std(smooth) / 0.01 < most


def test_unseen_it_goes_on_turning_and_is_found_again_without_a_jump() -> None:
    yaw = 1.0 * T_S
    course = _observed(yaw, 6, unseen=slice(200, 220))
    assert np.abs(course[200:, 0] - yaw[200:]).max() < 0.02
    assert course[200:220, 2] == pytest.approx(0.0)
    assert np.abs(course[200:, 1] - 1.0).max() < 0.2


def test_a_heading_that_passes_half_a_turn_is_unwrapped() -> None:
    course = _observed(2.0 * T_S, 7)
    assert course[-1, 0] == pytest.approx(2.0 * T_S[-1], abs=0.01)

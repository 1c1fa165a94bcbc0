"""When a drone that is led down counts as standing on the floor, by its height as it is seen."""

import numpy as np
import pytest

from gcs.drones.land_detector import LandDetector
from tests.gcs.fakes import PX4_OFFBOARD
from tests.gcs.link import Drone as OtherEnd
from tests.gcs.link import a_link, beat

FALLING_M_S = -0.47
"""What the estimate comes to on the floor where the reference is led on far under it."""


def landed_after_s(heights_m: np.ndarray, rate_hz: float, mode: int = PX4_OFFBOARD) -> float | None:
    link = a_link()
    OtherEnd().say(link, beat(armed=True, mode=mode))
    floor, low = LandDetector(lifted=True), 0.5 * link.hover_thrust_norm
    for k, height_m in enumerate(heights_m.tolist()):
        now_ns = round(k / rate_hz * 1e9)
        floor.detect_lift_off(link, (0.0, 0.0, height_m), True, low)
        if floor.detect_touch_down(link, FALLING_M_S, 0.3, low, now_ns):
            return now_ns * 1e-9
    return None


@pytest.mark.parametrize(("rate_hz", "noise_m"), [(100.0, 1e-4), (30.0, 1e-4), (30.0, 2e-3), (200.0, 2e-3)])
def test_a_drone_that_stands_has_landed_whatever_speed_is_estimated(rate_hz, noise_m):
    t_s = np.arange(0.0, 3.0, 1.0 / rate_hz)
    noise_m = noise_m * np.random.default_rng(7).standard_normal(len(t_s))
    after_s = landed_after_s(np.maximum(0.3 - 0.3 * t_s, 0.0) + noise_m, rate_hz)
    assert after_s is not None
    assert 1.0 + 0.3 < after_s < 1.0 + 0.8


def test_a_drone_that_sinks_past_its_floor_height_has_not():
    t_s = np.arange(0.0, 3.0, 0.01)
    assert landed_after_s(0.3 - 0.3 * t_s, 100.0) is None


def test_a_drone_that_hovers_near_the_floor_in_a_pilots_mode_has_not():
    assert landed_after_s(np.full(300, 0.02), 100.0, mode=3 << 16) is None

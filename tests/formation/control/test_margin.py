import numpy as np
import pytest

from formation.config import MocapConfig
from formation.control.margin import delay_margin, held, is_carried, kicked_hover
from formation.control.presets import preset, preset_for
from formation.vehicle.profile import PROFILES, GainScale, profile

CAMERAS = MocapConfig()


@pytest.mark.parametrize("name", sorted(PROFILES))
def test_the_default_preset_is_carried_with_room(name: str) -> None:
    body = profile(name)
    gains = preset_for("default", body, CAMERAS)
    loop_s = CAMERAS.delay_s + body.response_dead_time_s + body.response_lag_s
    assert is_carried(body, gains, CAMERAS)
    assert held(body, gains, CAMERAS, 0.2 * loop_s)


@pytest.mark.parametrize("name", sorted(PROFILES))
def test_the_height_is_held_although_cameras_and_thrust_are_later_than_believed(name: str) -> None:
    """By 0.7 of their dead times, on the code that flies: kicked upwards it comes back to 5 mm."""
    body = profile(name)
    extra_s = 0.7 * (CAMERAS.delay_s + body.thrust_dead_time_s)
    path = kicked_hover(body, preset_for("default", body, CAMERAS), CAMERAS, extra_s, 6.0, upwards=True)
    assert np.abs(path[-100:, 2] - 1.0).max() < 0.005
    assert np.abs(path[:50, 2] - 1.0).max() > 0.01


def test_a_height_loop_that_is_too_fast_for_its_delay_swings() -> None:
    body = profile("px4_quad")
    fast = body.model_copy(update={"gain_scale": GainScale(vertical=1.5)})
    path = kicked_hover(body, preset_for("default", fast, CAMERAS), CAMERAS, 0.045, 6.0, upwards=True)
    assert not np.abs(path[-100:, 2] - 1.0).max() < 0.005


def test_the_printed_gains_cannot_be_carried_by_a_px4() -> None:
    margin = delay_margin(profile("px4_quad"), preset("paper"), CAMERAS)
    assert not margin.carried
    assert not is_carried(profile("px4_quad"), preset("paper"), CAMERAS)
    assert "px4_quad" in str(margin)
    assert "178 ms" in str(margin)


def test_too_much_delay_is_seen() -> None:
    body = profile("paper_40g")
    assert not held(body, preset("default"), CAMERAS, 0.18)


def test_a_labs_own_vehicle_has_a_margin_under_its_own_name() -> None:
    own = profile("paper_40g").model_copy(update={"name": "ours"})
    margin = delay_margin(own, preset_for("default", own, CAMERAS), CAMERAS)
    assert margin.carried
    assert "ours" in str(margin)

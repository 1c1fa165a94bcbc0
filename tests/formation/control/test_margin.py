import pytest

from formation.config import MocapConfig
from formation.control.margin import delay_margin, held
from formation.control.presets import preset, preset_for
from formation.vehicle.profile import PROFILES, profile

CAMERAS = MocapConfig()


@pytest.mark.parametrize("name", sorted(PROFILES))
def test_the_default_preset_is_carried_with_room(name: str) -> None:
    body = profile(name)
    margin = delay_margin(body, preset_for("default", body, CAMERAS), CAMERAS)
    assert margin.carried
    assert margin.margin_s > 0.2 * margin.loop_s


def test_the_printed_gains_cannot_be_carried_by_a_px4() -> None:
    margin = delay_margin(profile("px4_quad"), preset("paper"), CAMERAS)
    assert not margin.carried
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

"""What one viewer of the page sends or breaks is no other's: no browser, no bus."""

from pathlib import Path
from types import SimpleNamespace

import pytest

from gcs.page.shell import Page
from gcs.page.viewer import MOVED_MOST, moved_px
from tests.gcs.fakes import triangle
from wire.clock import Clock


@pytest.mark.parametrize("moved", ["inf", "-inf", "nan", 2 * MOVED_MOST, "far", None, [1.0]])
def test_only_what_a_mouse_can_do_turns_the_room(moved: object) -> None:
    with pytest.raises((TypeError, ValueError)):
        moved_px(moved)
    assert moved_px("-12.5") == -12.5


def test_a_viewer_that_cannot_be_drawn_ends_nobody_elses_page() -> None:
    page, drawn = Page(Path("lab.toml"), triangle(), "main", Clock()), []

    def fail(_shown: object) -> None:
        raise ValueError("math domain error")

    page._viewers["bad"] = SimpleNamespace(visitor=None, name="bad", update=fail)
    page._viewers["good"] = SimpleNamespace(visitor=None, name="good", update=drawn.append)
    page.draw()
    page.draw()
    assert len(drawn) == 2
    assert "bad" not in page._viewers
    assert "math domain error" in page.model.alarms.open[0].text

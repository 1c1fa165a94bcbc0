"""The README's figures of the paper's experiments are those of the figure file, as are the manual's tables."""

import json

import pytest

from tests.docs.manual_pages import ROOT
from tools.figures.page_pictures import TAKEN_OF, sources_hash

CONTROLLERS = json.loads((ROOT / "docs/paper/paper_40g.json").read_text(encoding="utf-8"))["controllers"]
ROWS = [line for line in (ROOT / "README.md").read_text(encoding="utf-8").splitlines() if line.startswith("|")]


@pytest.mark.parametrize(
    ("row", "controller", "figure", "words"),
    [
        ("| circle, 40 g vehicle |", "cfc", "circle_rms_m", "{:.2f} mm RMS"),
        ("| gust that moves", "cfc", "gust_mean_dev_m", "{:.0f} mm ("),
        ("| gust that moves", "cfc_imu", "gust_mean_dev_m", "({:.0f} mm with the drones' accelerometers)"),
    ],
)
def test_the_readme_tells_what_was_measured(row: str, controller: str, figure: str, words: str) -> None:
    (shown,) = (line for line in ROWS if line.startswith(row))
    assert words.format(1e3 * CONTROLLERS[controller][figure]) in shown


def test_the_manuals_pictures_are_of_todays_page() -> None:
    """`make pictures`, or `python -m tools.figures.page_pictures docs/page`, takes them again."""
    assert (ROOT / "docs" / "page" / TAKEN_OF).read_text(encoding="ascii").strip() == sources_hash()

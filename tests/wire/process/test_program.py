"""What the Tab key offers."""

from pathlib import Path
from types import SimpleNamespace

import pytest

from drone_agent.__main__ import _bodies
from gcs.cli.operator import offered_shapes, offered_trajectories
from sim.cli.app import _scenarios
from wire.process.program import bodies_of, lab_near

LAB = """
[leader]
body = "lead"
trajectories.eight = { kind = "figure8" }
[[followers]]
body = "left"
[formation.shapes]
stairs = []
"""


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / "lab.toml").write_text(LAB)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_names_of_the_lab_file_are_offered(here: Path):
    meant = SimpleNamespace(params={"lab": str(here / "lab.toml")})
    assert offered_shapes(meant, "st") == ["stairs"]
    assert "line" in offered_shapes(meant, "")
    assert offered_trajectories(meant, "") == ["configured", "eight"]
    assert _bodies("l") == ["lead", "left"]


def test_what_is_shipped_is_offered(here: Path):
    assert _scenarios("triangle") == ["triangle_circle", "triangle_line"]
    assert _scenarios("lab") == ["lab.toml"]


def test_a_file_that_is_missing_or_wrong_offers_nothing(tmp_path: Path):
    assert lab_near(tmp_path / "no.toml") == {}
    assert bodies_of({"leader": 3, "followers": {"body": "x"}}) == []

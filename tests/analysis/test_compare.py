"""Two synthetic flights side by side, whose differences are known."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from analysis.cli import app
from tests.analysis.synthetic_flight import LAB, METADATA, Recipe, written


def flown(path: Path, error_mm: float, metadata: dict[str, str]) -> Path:
    error = 1e-3 * error_mm * np.array([[1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
    return written(path, Recipe(error_lead=lambda _: error), metadata)


@pytest.fixture(scope="module")
def two(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    folder = tmp_path_factory.mktemp("two")
    slower = LAB.model_copy(update={"limits": LAB.limits.model_copy(update={"speed_m_s": 0.75})})
    told = {**METADATA, "lab": slower.model_dump_json(), "gains": json.dumps({"paper_40g": {"c": 5.0}})}
    before = {**METADATA, "gains": json.dumps({"paper_40g": {"c": 4.0}})}
    return flown(folder / "before.mcap", 2.0, before), flown(folder / "after.mcap", 3.0, told)


def test_numbers_differences_and_configuration_as_json(two: tuple[Path, Path]) -> None:
    done = CliRunner().invoke(app, ["compare", *map(str, two), "--json"])
    assert done.exit_code == 0, done.output
    told = json.loads(done.stdout)
    # A log holds places in single precision: to 0.1 micrometres.
    assert told["a"]["formation_rms_m"] == pytest.approx(0.002, abs=1e-7)
    assert told["difference"]["formation_rms_m"] == pytest.approx(0.001, abs=1e-7)
    assert told["difference"]["duration_s"] == 0.0
    assert told["configuration"] == {
        "lab.limits.speed_m_s": [LAB.limits.speed_m_s, 0.75], "gains.paper_40g.c": [4.0, 5.0]
    }  # fmt: skip


def test_the_page_beside_the_first_log_is_self_contained_and_lays_both_over_each_other(
    two: tuple[Path, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    done = CliRunner().invoke(app, ["compare", *map(str, two)])
    assert done.exit_code == 0, done.output
    assert "formation_rms_m" in done.output
    assert not list(tmp_path.iterdir())
    text = two[0].with_name("compared.html").read_text()
    assert re.findall(r'<section id="(\w+)"', text) == ["numbers", "error", "leader", "paths", "setup"]
    assert not re.search(r'(src|href)="(?!#|data:)', text)
    assert "Not shown" not in text
    assert "before.mcap, RMS 2 mm" in text
    assert "after.mcap, RMS 3 mm" in text
    assert "+50.0" in text
    assert "lab.limits.speed_m_s" in text

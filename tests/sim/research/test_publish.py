"""What a paper is given of two synthetic flights, whose numbers are known."""

import hashlib
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from sim.cli.log import app
from tests.analysis.synthetic_flight import METADATA, Recipe, written


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """circle: 2 mm off; line_2: 3 mm off."""
    root, made = tmp_path_factory.mktemp("paper"), []
    for name, error_mm in (("circle", 2.0), ("line_2", 3.0)):
        error = 1e-3 * error_mm * np.array([[1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
        (root / name).mkdir()
        written(root / name / "flight.mcap", Recipe(error_lead=lambda _, error=error: error), METADATA)
        made.append(root / name)
    return made


def test_everything_a_paper_needs_is_written(folders: list[Path], tmp_path: Path) -> None:
    out = tmp_path / "figures"
    done = CliRunner().invoke(app, ["paper", *map(str, folders), "--out", str(out)])
    assert done.exit_code == 0, done.output
    for name in ("circle-error", "circle-paths", "line_2-error", "line_2-paths"):
        assert (out / f"{name}.pdf").read_bytes().startswith(b"%PDF")
        assert "<svg" in (out / f"{name}.svg").read_text()
    numbers = (out / "numbers.tex").read_text()
    assert "\\newcommand{\\CircleRms}{2}\n" in numbers
    assert "\\newcommand{\\LineTwoRms}{3}\n" in numbers
    text = (out / "table.tex").read_text()
    assert text.count("\\\\") == 3
    assert "line\\_2 & 3 & " in text
    assert "\\toprule" in text
    methods = (out / "methods.tex").read_text()
    assert "50~Hz" in methods
    assert "Control law: preset default" in methods
    assert (out / "CITATION.cff").read_text().startswith("cff-version: 1.2.0")
    hashes = [
        f"{hashlib.sha256(log.read_bytes()).hexdigest()}  {log}\n" for log in (f / "flight.mcap" for f in folders)
    ]
    assert (out / "hashes.txt").read_text() == "".join(hashes)
    column_pt = 88.9 / 25.4 * 72.0
    assert f'width="{column_pt:g}pt"' in (out / "circle-error.svg").read_text()


def test_what_cannot_be_published_is_named(folders: list[Path], tmp_path: Path) -> None:
    done = CliRunner().invoke(app, ["paper", str(folders[0]), str(folders[0]), "--out", str(tmp_path)])
    assert (done.exit_code, "two flights are called Circle" in done.output) == (2, True)
    assert CliRunner().invoke(app, ["paper", str(tmp_path / "none"), "--out", str(tmp_path)]).exit_code == 2

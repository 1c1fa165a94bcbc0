"""The command lines of the studies: what they refuse, and the paper's figures."""

import re
from pathlib import Path

import pytest
from typer.testing import CliRunner

from mavlink_formation.installation import install_command
from sim.cli.app import app
from sim.research.paper_figures import NAMES


def invoke(*arguments: str) -> tuple[int, str]:
    result = CliRunner().invoke(app, list(arguments))
    return result.exit_code, " ".join(result.output.split())


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("paper", "--vehicle", "brick"), "unknown vehicle profile 'brick'; known: paper_40g, paper_40g_printed"),
        (("paper", "--only", "pdi"), "unknown controller 'pdi'; known: smc, istsmc"),
        (("tune", "paper_40g", "--law", "pdi"), "no package here registers 'pdi' control presets: paper_smc"),
        (
            ("campaign", "--scheduler", "tcp/x:1"),
            f"--scheduler tcp/x:1: needs distributed {install_command('research')}",
        ),
    ],
)
def test_what_is_unknown_is_refused_by_name(arguments: tuple[str, ...], said: str) -> None:
    code, output = invoke(*arguments)
    assert code == 2
    assert all(word in output for word in said.split())


def test_the_papers_figures_and_tables_are_written(tmp_path: Path) -> None:
    """Numbers of the printed tables are those of the paper; each figure names who is in it."""
    done = CliRunner().invoke(
        app, ["paper", "--seeds", "1", "--only", "istsmc", "--only", "pid", "--out", str(tmp_path)]
    )
    assert done.exit_code == 0, done.output
    folder = tmp_path / "figures"
    for name in ("figure-5", "figure-6", "figure-6-error", "figure-7", "figure-7-error"):
        assert (folder / f"{name}.pdf").read_bytes().startswith(b"%PDF")
        svg = (folder / f"{name}.svg").read_text(encoding="utf-8")
        assert all(NAMES[name] in svg for name in ("istsmc", "pid"))
    tables = {name: (folder / f"{name}.tex").read_text(encoding="utf-8") for name in ("table-1", "table-2", "results")}
    for cells in ("mass, kg & 0.04", "Jxx, kg m² & 0.0001532", "Jzz, kg m² & 0.0003472", "wheelbase, m & 0.12"):
        assert rf"{cells} \\" in tables["table-1"]
    assert r"ISTSMC & c = 1, p1 = 8, p2 = 0.1, ε = -0.49 \\" in tables["table-2"]
    assert r"SMC & c = 1, k = 5 \\" in tables["table-2"]
    assert re.search(r"gust: mean of largest, mm & [23]\d\d\.\d \(300\)", tables["results"])

"""The command lines of the studies: what they refuse."""

import pytest
from typer.testing import CliRunner

from sim.cli.app import app


def invoke(*arguments: str) -> tuple[int, str]:
    result = CliRunner().invoke(app, list(arguments))
    return result.exit_code, " ".join(result.output.split())


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("paper", "--vehicle", "brick"), "unknown vehicle profile 'brick'; known: paper_40g, paper_40g_printed"),
        (("paper", "--only", "pdi"), "unknown controller 'pdi'; known: smc, istsmc"),
        (("tune", "paper_40g", "--gains", "pdi"), "unknown control preset 'pdi'"),
    ],
)
def test_what_is_unknown_is_refused_by_name(arguments: tuple[str, ...], said: str) -> None:
    code, output = invoke(*arguments)
    assert code == 2
    assert all(word in output for word in said.split())

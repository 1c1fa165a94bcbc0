"""The README's tables are the tables the ground runs on, and its configurations load."""

import re
import tomllib
from pathlib import Path

import pytest

from formation import phase, safety
from formation.config import LabConfig
from wire.config_file import parse

README = (Path(__file__).parent.parent / "README.md").read_text(encoding="utf-8")


@pytest.mark.parametrize(("name", "table"), [("rules", safety.rules_markdown()), ("phases", phase.table_markdown())])
def test_readme_shows_the_table_in_force(name: str, table: str) -> None:
    shown = README.split(f"<!-- {name} -->")[1].split(f"<!-- end of {name} -->")[0].strip()
    assert shown == table, f"the README's table of {name} is out of date: paste what `gcs rules` prints"


def test_a_lab_shown_can_be_flown() -> None:
    """A snippet without bodies of its own belongs to the first lab."""
    first, *others = (tomllib.loads(text) for text in re.findall(r"```toml\n(.*?)```", README, re.DOTALL))
    for snippet in (first, *others):
        parse(snippet if "leader" in snippet else {**first, **snippet}, LabConfig, source="README.md")
    assert others

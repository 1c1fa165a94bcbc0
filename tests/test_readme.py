"""The README's tables are the tables the ground runs on."""

from pathlib import Path

import pytest

from formation import phase, safety

README = (Path(__file__).parent.parent / "README.md").read_text(encoding="utf-8")


@pytest.mark.parametrize(("name", "table"), [("rules", safety.rules_markdown()), ("phases", phase.table_markdown())])
def test_readme_shows_the_table_in_force(name: str, table: str) -> None:
    shown = README.split(f"<!-- {name} -->")[1].split(f"<!-- end of {name} -->")[0].strip()
    assert shown == table, f"the README's table of {name} is out of date: paste what `gcs rules` prints"

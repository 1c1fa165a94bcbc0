"""The release and the commit it was made from."""

import re
import tomllib
from pathlib import Path

from wire import version

ROOT = Path(__file__).parents[2]


def test_the_release_has_one_source():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    assert project["project"]["dynamic"] == ["version"]
    found = re.search(project["tool"]["hatch"]["version"]["pattern"], Path(version.__file__).read_text(), re.MULTILINE)
    assert found is not None
    assert found["version"] == version.VERSION


def test_text_names_release_and_commit():
    assert re.fullmatch(rf"mavlink-formation {version.VERSION}, commit ([0-9a-f]{{12,}}\+?|unknown)", version.text())

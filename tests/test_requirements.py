"""requirements.txt holds every package that the project needs, each by the hashes of its files, and no index."""

import re
import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[1]
LOCK = (ROOT / "requirements.txt").read_text(encoding="utf-8")
# One package may be there twice, for older and for newer Pythons.
LOCKED = re.findall(r"^([\w.-]+)==\S+[^\n]*\\\n((?:    --hash=\S+(?: \\)?\n)+)", LOCK, re.M)


def test_locks_every_dependency_of_the_project():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    needed = {re.split(r"[<>=]", dependency)[0].lower() for dependency in project["dependencies"]}
    assert needed <= {name.lower() for name, _ in LOCKED}


def test_every_line_that_is_no_comment_belongs_to_a_hashed_package():
    lines = [line for line in LOCK.splitlines() if line.strip() and not line.strip().startswith("#")]
    assert len(lines) == sum(1 + hashes.count("--hash=") for _, hashes in LOCKED)
    assert all(re.fullmatch(r"(?:    --hash=sha256:[0-9a-f]{64}(?: \\)?\n)+", hashes) for _, hashes in LOCKED)


def test_names_no_index():
    assert "://" not in LOCK
    assert "--index-url" not in LOCK

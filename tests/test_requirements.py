"""requirements.txt holds every package that the project needs, each by the hashes of its files, and no index."""

import re
import tomllib
from importlib.metadata import packages_distributions
from pathlib import Path

from mavlink_formation import programs

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
PARTS = PROJECT["optional-dependencies"]
LOCK = (ROOT / "requirements.txt").read_text(encoding="utf-8")
# One package may be there twice, for older and for newer Pythons.
LOCKED = re.findall(r"^([\w.-]+)==\S+[^\n]*\\\n((?:    --hash=\S+(?: \\)?\n)+)", LOCK, re.M)


def packages(requirements: list[str]) -> set[str]:
    return {re.split(r"[<>=\[]", requirement)[0].lower() for requirement in requirements}


def test_locks_every_dependency_of_the_project_and_its_parts():
    needed = packages(PROJECT["dependencies"]).union(*(packages(PARTS[part]) for part in programs._EXTRAS))
    assert needed <= {name.lower() for name, _ in LOCKED}


def test_each_part_is_known_by_what_is_imported_of_it():
    found = packages_distributions()
    for part, roots in programs._EXTRAS.items():
        of_roots = {root: {name.lower().replace("_", "-") for name in found[root]} for root in roots}
        assert all(names & packages(PARTS[part]) for names in of_roots.values()), of_roots
        assert packages(PARTS[part]) <= set().union(*of_roots.values())


def test_every_line_that_is_no_comment_belongs_to_a_hashed_package():
    lines = [line for line in LOCK.splitlines() if line.strip() and not line.strip().startswith("#")]
    assert len(lines) == sum(1 + hashes.count("--hash=") for _, hashes in LOCKED)
    assert all(re.fullmatch(r"(?:    --hash=sha256:[0-9a-f]{64}(?: \\)?\n)+", hashes) for _, hashes in LOCKED)


def test_names_no_index():
    assert "://" not in LOCK
    assert "--index-url" not in LOCK

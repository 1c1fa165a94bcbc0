"""The manual's tables of figures and attacks: each row names a test that is there."""

import re
from pathlib import Path

ROOT = Path(__file__).parents[3]
ATTACKS, FIGURES = 21, 13


def named(pattern: str) -> list[tuple[str, str]]:
    """Files and tests that the page names where the pattern is, which has both as its groups."""
    manual = (ROOT / "docs" / "manual" / "reference" / "security-figures.md").read_text(encoding="utf-8")
    return re.findall(pattern, manual, re.MULTILINE)


def test_each_attack_of_the_manual_has_its_test() -> None:
    assert len(named(r"^\|[^|]+\| `(tests/[^:`]+)::(test_\w+)` \|$")) == ATTACKS


def test_each_test_that_the_page_names_is_there() -> None:
    tests = named(r"`(tests/[^:`]+)::(test_\w+)`")
    assert len(tests) == ATTACKS + FIGURES
    for file, test in tests:
        assert re.search(rf"^(async )?def {test}\(", (ROOT / file).read_text(encoding="utf-8"), re.MULTILINE), (
            file,
            test,
        )

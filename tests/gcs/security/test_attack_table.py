"""The manual's table of attacks: each row names a test that is there."""

import re
from pathlib import Path

ROOT = Path(__file__).parents[3]
ATTACKS = 20


def test_each_attack_of_the_manual_has_its_test() -> None:
    manual = (ROOT / "docs" / "manual" / "reference" / "security-figures.md").read_text(encoding="utf-8")
    named = re.findall(r"^\|[^|]+\| `(tests/[^:`]+)::(test_\w+)` \|$", manual, re.MULTILINE)
    assert len(named) == ATTACKS
    for file, test in named:
        assert re.search(rf"^def {test}\(", (ROOT / file).read_text(encoding="utf-8"), re.MULTILINE), (file, test)

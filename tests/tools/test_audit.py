"""What pip-audit says, by its own output (2.10.1), and what is made of it."""

import json

import pytest

from tools.audit import UNKNOWN, VULNERABLE, judge

SKIPPED = {
    "name": "aiofiles",
    "skip_reason": "Dependency not found on PyPI and could not be audited: aiofiles (25.1.0)",
}
CLEAN = {"name": "typer", "version": "0.20.0", "vulns": []}
VULNERABLE_ONE = {
    "name": "flask", "version": "0.5",
    "vulns": [{"id": "PYSEC-2019-179", "fix_versions": ["1.0"], "aliases": [], "description": ""}],
}  # fmt: skip


def report(*packages: dict[str, object]) -> str:
    return json.dumps({"dependencies": packages, "fixes": []})


@pytest.mark.parametrize(
    ("text", "code", "words"),
    [
        (report(CLEAN), 0, "1 packages: none vulnerable"),
        (report(CLEAN, VULNERABLE_ONE), VULNERABLE, "flask 0.5: PYSEC-2019-179, mended in 1.0"),
        (report(SKIPPED), UNKNOWN, "not audited: 1 of 1 packages"),
        (report(VULNERABLE_ONE, SKIPPED), VULNERABLE, "not audited: 1 of 2 packages"),
        ("", UNKNOWN, "not audited"),
    ],
)
def test_only_what_was_looked_up_is_called_free_of_vulnerabilities(text: str, code: int, words: str) -> None:
    verdict = judge(text)
    assert verdict.code == code
    assert words in verdict.text

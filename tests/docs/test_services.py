"""The udev rules that are shipped."""

import re

from tests.docs.manual_pages import ROOT

RULES = ROOT / "contrib" / "udev" / "90-mavlink-formation.rules"


def test_udev_rules_are_rules() -> None:
    rules = [line for line in RULES.read_text(encoding="utf-8").splitlines() if line and not line.startswith("#")]
    pair = re.compile(r'[A-Z_]+(\{\w+\})?(==|\+=|=)"[^"]*"')
    assert rules
    assert all(pair.fullmatch(part) for rule in rules for part in rule.split(", ")), rules

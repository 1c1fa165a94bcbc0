"""The page that says where to add what names files and names that are there."""

import re
from pathlib import Path
from typing import NamedTuple

from wire.mavlink.messages import AS_IS, row

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs/decisions/0018-where-to-add-what.md").read_text(encoding="utf-8")
EXAMPLES = PAGE.partition("<!-- examples -->")[2].partition("<!-- /examples -->")[0]
OURS = ("formation", "wire", "mocap", "gcs", "drone_agent", "sim")
NEW = {"RotorSpeed"}


class RotorSpeed(NamedTuple):
    """As the page describes it."""

    motor: int
    speed_rev_min: float


def test_every_file_is_there() -> None:
    named = [name for name in re.findall(r"`([\w/.]+)`", EXAMPLES) if "/" in name and "NAME" not in name]
    assert len(named) > 15
    assert [name for name in named if not (ROOT / name).exists()] == []


def test_every_name_is_in_the_code() -> None:
    code = "\n".join(path.read_text(encoding="utf-8") for folder in OURS for path in (ROOT / folder).rglob("*.py"))
    named = {part for name in re.findall(r"`([A-Za-z_.]+)`", EXAMPLES) for part in name.split(".")} - NEW
    assert {"TABLE", "PHASES", "RULES", "open_source", "_as_sent"} <= named
    assert [name for name in sorted(named) if not re.search(rf"\b{name}\b", code)] == []


def test_the_message_shown_is_the_one_of_mavlink() -> None:
    """RAW_RPM (339): index, frequency."""
    assert 'row("RAW_RPM", m.RotorSpeed, motor=AS_IS, speed_rev_min=AS_IS)' in EXAMPLES
    made = row("RAW_RPM", RotorSpeed, motor=AS_IS, speed_rev_min=AS_IS)
    assert (made.layout.id, made.read((1, 2000.0))) == (339, RotorSpeed(1, 2000.0))

"""The manual's pages as tests see them: their blocks in order, and the lab files that their TOML blocks add up to."""

import re
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import tomli_w

ROOT = Path(__file__).parents[2]
MANUAL = ROOT / "docs" / "manual"

BASE_LAB: dict[str, Any] = {
    "name": "lab",
    "leader": {"body": "leader", "sysid": 1, "trajectory": {"kind": "line", "length_m": 0.5, "duration_s": 4.0}},
    "followers": [
        {"body": "right", "sysid": 2, "offset_m": [-0.4, -0.4, 0.0]},
        {"body": "left", "sysid": 3, "offset_m": [-0.4, 0.4, 0.0]},
    ],
}
"""What a page's snippet is laid over, where the page shows no whole lab file."""


def pages() -> list[Path]:
    """Every page of the manual, and the README."""
    return [ROOT / "README.md", *(p for p in sorted(MANUAL.rglob("*.md")) if "_build" not in p.parts)]


def name_of(page: Path) -> str:
    """How a test names a page."""
    return str(page.relative_to(ROOT))


@dataclass(frozen=True, slots=True)
class Block:
    """A fenced block: its language and its text."""

    language: str
    text: str


def blocks(page: Path) -> list[Block]:
    """The fenced blocks of a page, in order."""
    text = page.read_text(encoding="utf-8")
    return [Block(found[1], found[2]) for found in re.finditer(r"^```(\w+)\n(.*?)^```", text, re.DOTALL | re.MULTILINE)]


def shell_lines(block: Block) -> Iterator[str]:
    """The commands of a shell block, comments dropped."""
    for line in block.text.splitlines():
        for command in re.split(r"&&|;", re.sub(r"\s#.*", "", line)):
            if command.strip() and not command.strip().startswith("#"):
                yield command.strip()


@dataclass
class Labs:
    """The lab file of a page: each TOML block replaces it or is laid over it."""

    lab: dict[str, Any]
    scenario: str | None = None

    def take(self, block: Block) -> None:
        """Read one TOML block."""
        values = tomllib.loads(block.text)
        values.pop("include", None)  # a room, which is a block before it
        if "lab" in values:
            self.scenario = block.text
        else:
            self.lab = values if "leader" in values and "followers" in values else laid_over(self.lab, values)

    @property
    def text(self) -> str:
        """The lab file as TOML."""
        return tomli_w.dumps(self.lab)


def laid_over(below: dict[str, Any], above: dict[str, Any]) -> dict[str, Any]:
    """Tables merged key by key; lists and values replaced."""
    merged = dict(below)
    for key, value in above.items():
        both = isinstance(value, dict) and isinstance(merged.get(key), dict)
        merged[key] = laid_over(merged[key], value) if both and key != "trajectory" else value
    return merged

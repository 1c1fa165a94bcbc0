"""The lists of wrong changes still speak of the code there is."""

import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[3]
SOURCES = [f.read_text(encoding="utf-8") for f in sorted((ROOT / "formation").rglob("*.py"))]
NAMED = tomllib.loads((ROOT / "tools/mutants" / "named.toml").read_text(encoding="utf-8"))["mutant"]
EXCUSED = tomllib.loads((ROOT / "tools/mutants" / "equivalent.toml").read_text(encoding="utf-8")).get("equivalent", [])


@pytest.mark.parametrize("entry", NAMED, ids=lambda e: e["name"])
def test_what_is_named_is_there_once(entry: dict[str, str]) -> None:
    sources = [(ROOT / entry["file"]).read_text(encoding="utf-8")] if "file" in entry else SOURCES
    assert sum(source.count(entry["old"]) for source in sources) == 1


def test_what_is_excused_is_there_and_has_a_reason() -> None:
    lines = {line.strip() for source in SOURCES for line in source.splitlines()}
    assert [e["line"] for e in EXCUSED if e["line"] not in lines or not e["reason"]] == []

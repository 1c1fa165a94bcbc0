"""The tool that makes wrong changes: what it makes of a source, and that its lists still speak of the code there is."""

import ast
import tomllib
from pathlib import Path

import pytest

from tools.mutants.mutations import changed, changes

ROOT = Path(__file__).resolve().parents[3]
SOURCES = [f.read_text(encoding="utf-8") for f in sorted((ROOT / "formation").rglob("*.py"))]
NAMED = tomllib.loads((ROOT / "tools/mutants" / "named.toml").read_text(encoding="utf-8"))["mutant"]
EXCUSED = tomllib.loads((ROOT / "tools/mutants" / "equivalent.toml").read_text(encoding="utf-8")).get("equivalent", [])

SOURCE = '''"""A text."""
LIMIT: Final[float] = 2.0

@kernel(cache=True)
def f(a: float, b: float) -> float:
    """What it does."""
    c = -g(a, b) + 3 * min(a, LIMIT)
    if not a < b:
        c += 1.0
    return c
'''


def made(source: str) -> set[str]:
    return {ast.unparse(changed(source, change)) for change in changes("f.py", source)}


def test_operators_numbers_signs_arguments_comparisons_and_terms_are_changed() -> None:
    found = {(c.old, c.new) for c in changes("f.py", SOURCE)}
    assert found == {
        ("2.0", "3.0"),
        ("-g(a, b) + 3 * min(a, LIMIT)", "-g(a, b) - 3 * min(a, LIMIT)"),
        ("-g(a, b) + 3 * min(a, LIMIT)", "-g(a, b)"),
        ("-g(a, b) + 3 * min(a, LIMIT)", "3 * min(a, LIMIT)"),
        ("-g(a, b)", "g(a, b)"),
        ("g(a, b)", "g(b, a)"),
        ("3 * min(a, LIMIT)", "3 / min(a, LIMIT)"),
        ("3 * min(a, LIMIT)", "3"),
        ("3 * min(a, LIMIT)", "min(a, LIMIT)"),
        ("3", "4"),
        ("min(a, LIMIT)", "max(a, LIMIT)"),
        ("not a < b", "a < b"),
        ("a < b", "a >= b"),
        ("c += 1.0", "c -= 1.0"),
        ("c += 1.0", "pass"),
        ("1.0", "1.5"),
    }


def test_each_change_is_another_program_and_none_is_the_source() -> None:
    assert len(made(SOURCE)) == len(changes("f.py", SOURCE))
    assert ast.unparse(ast.parse(SOURCE)) not in made(SOURCE)


def test_a_change_knows_its_statements_lines_and_when_it_runs() -> None:
    by_new = {c.new: c for c in changes("f.py", SOURCE)}
    assert (by_new["3.0"].lines, by_new["3.0"].called) == ((2, 2), False)
    assert (by_new["g(b, a)"].lines, by_new["g(b, a)"].called) == ((7, 7), True)
    assert by_new["a >= b"].lines == (8, 8)


@pytest.mark.parametrize("entry", NAMED, ids=lambda e: e["name"])
def test_what_is_named_is_there_once(entry: dict[str, str]) -> None:
    sources = [(ROOT / entry["file"]).read_text(encoding="utf-8")] if "file" in entry else SOURCES
    assert sum(source.count(entry["old"]) for source in sources) == 1


def test_what_is_excused_is_there_and_has_a_reason() -> None:
    lines = {line.strip() for source in SOURCES for line in source.splitlines()}
    assert [e["line"] for e in EXCUSED if e["line"] not in lines or not e["reason"]] == []

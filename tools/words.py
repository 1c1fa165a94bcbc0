"""Where the project's words are not the field's: identifiers, sentences and documents, by the dictionary `words.toml`.

python -m tools.words            # every place, a line each; exit code 1 if there is one
python -m tools.words gcs wire   # of these folders
"""

import ast
import itertools
import re
import sys
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("formation", "wire", "mocap", "gcs", "drone_agent", "sim", "analysis", "gcs_log", "mavlink_formation")
DOCUMENTS = ("README.md", "CONTRIBUTING.md", "SECURITY.md", "docs/manual")
PART = re.compile(r"[A-Z]?[a-z0-9]+|[A-Z]+(?![a-z])")
STORED = (ast.Store,)


@dataclass(frozen=True, slots=True)
class Place:
    """A word of ours: where it stands, in what, and what the field says instead."""

    file: str
    line: int
    found: str
    field: str


class Dictionary:
    """The words of `words.toml`, for names and for sentences."""

    def __init__(self, path: Path) -> None:
        values = tomllib.loads(path.read_text(encoding="utf-8"))
        self._allowed = [name.split("_") for name in values["allow"]]
        self._names = {ours: entry["field"] for entry in values["word"] for ours in entry["ours"]}
        texts = {ours: entry["field"] for entry in values["word"] if entry["where"] == "text" for ours in entry["ours"]}
        self._texts = texts
        self._sentence = re.compile(r"(?<![\w-])(" + "|".join(sorted(texts)) + r")(?![\w-])", re.IGNORECASE)

    def of_name(self, name: str) -> str:
        """The field's word for one of ours in an identifier; empty where there is none."""
        parts = [part.lower() for part in PART.findall(name)]
        for allowed in self._allowed:
            n = len(allowed)
            for at in range(len(parts) - n, -1, -1):
                if parts[at : at + n] == allowed:
                    del parts[at : at + n]
        pairs = [*parts, *(f"{a}_{b}" for a, b in itertools.pairwise(parts))]
        return next((f"{part}: {self._names[part]}" for part in pairs if part in self._names), "")

    def of_text(self, text: str) -> Iterator[tuple[int, str, str]]:
        """(offset, our word with what surrounds it, the field's) in a text, names in code left out."""
        plain = re.sub(r"`[^`\n]*`|\{[^{}\n]*\}|\[\[.*?\]\]", lambda m: " " * len(m.group(0)), text)
        for found in self._sentence.finditer(plain):
            around = text[max(0, found.start() - 30) : found.end() + 30].replace("\n", " ")
            yield found.start(), around, f"{found.group(0)}: {self._texts[found.group(0).lower()]}"


def names_in(tree: ast.AST) -> Iterator[tuple[str, int]]:
    """Every name that a module defines or assigns, with its line."""
    for node in ast.walk(tree):
        match node:
            case ast.FunctionDef(name=name) | ast.AsyncFunctionDef(name=name) | ast.ClassDef(name=name):
                yield name, node.lineno
            case ast.arg(arg=name):
                yield name, node.lineno
            case ast.Name(id=name, ctx=ast.Store()) | ast.Attribute(attr=name, ctx=ast.Store()):
                yield name, node.lineno


def sentences_in(tree: ast.AST) -> Iterator[tuple[str, int]]:
    """Every text of two words and more in a module."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and " " in node.value.strip():
            yield node.value, node.lineno


def in_module(path: Path, words: Dictionary) -> Iterator[Place]:
    """Of one Python file: its name, its identifiers, its texts and its comments."""
    file, source = str(path.relative_to(ROOT)), path.read_text(encoding="utf-8")
    if field := words.of_name(path.stem):
        yield Place(file, 0, f"module {path.stem}", field)
    tree = ast.parse(source)
    seen: set[str] = set()
    for name, line in names_in(tree):
        if name not in seen and (field := words.of_name(name)):
            seen.add(name)
            yield Place(file, line, name, field)
    for text, line in sentences_in(tree):
        for at, around, field in words.of_text(text):
            yield Place(file, line + text.count("\n", 0, at), f"... {around} ...", field)
    for line, text in enumerate(source.splitlines(), 1):
        comment = text.partition("# ")[2] if '"' not in text else ""
        for _, around, field in words.of_text(comment):
            yield Place(file, line, f"# {around}", field)


def in_document(path: Path, words: Dictionary) -> Iterator[Place]:
    """Of one Markdown file; code blocks are left out."""
    text = re.sub(
        r"^```.*?^```", lambda m: "\n" * m.group(0).count("\n"), path.read_text(encoding="utf-8"), flags=re.M | re.S
    )
    for at, around, field in words.of_text(text):
        yield Place(str(path.relative_to(ROOT)), 1 + text.count("\n", 0, at), f"... {around} ...", field)


def places(folders: tuple[str, ...] = (*PACKAGES, *DOCUMENTS)) -> list[Place]:
    """Every place in those files and folders."""
    words = Dictionary(Path(__file__).with_suffix(".toml"))
    found: list[Place] = []
    for folder in folders:
        path = ROOT / folder
        files = [path] if path.is_file() else sorted(p for p in path.rglob("*") if "_build" not in p.parts)
        for file in files:
            if file.suffix == ".py":
                found += in_module(file, words)
            elif file.suffix == ".md":
                found += in_document(file, words)
    return found


def main() -> int:
    """Print the places; the exit code."""
    found = places(tuple(sys.argv[1:]) or (*PACKAGES, *DOCUMENTS))
    for place in found:
        print(f"{place.file}:{place.line}: {place.found} -> {place.field}")
    print(f"{len(found)} places", file=sys.stderr)
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())

"""Where the project's words are not the field's: names, sentences and documents, by the dictionary `words.toml`.

python -m tools.words            # every place, a line each; exit code 1 if there is one
python -m tools.words gcs wire   # of these folders
"""

import ast
import itertools
import re
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
LOOKED_AT = ("formation", "wire", "mocap", "gcs", "drone_agent", "sim", "analysis", "gcs_log", "mavlink_formation",
             "README.md", "CONTRIBUTING.md", "SECURITY.md", "docs/manual")  # fmt: skip
PART = re.compile(r"[A-Z]?[a-z0-9]+|[A-Z]+(?![a-z])")
NO_SENTENCE = re.compile(r"`[^`\n]*`|\{[^{}\n]*\}|\[\[.*?\]\]")
CODE_BLOCK = re.compile(r"^```.*?^```", re.MULTILINE | re.DOTALL)
NAMED = {ast.FunctionDef: "name", ast.AsyncFunctionDef: "name", ast.ClassDef: "name", ast.arg: "arg", ast.Name: "id",
         ast.Attribute: "attr"}  # fmt: skip

VALUES = tomllib.loads(Path(__file__).with_suffix(".toml").read_text(encoding="utf-8"))
ALLOWED = [name.split("_") for name in VALUES["allow"]]
FIELD = {ours: entry["field"] for entry in VALUES["word"] for ours in entry["ours"]}
TEXTS = sorted(ours for entry in VALUES["word"] if entry["where"] == "text" for ours in entry["ours"])
SENTENCE = re.compile(r"(?<![\w-])(" + "|".join(TEXTS) + r")(?![\w-])", re.IGNORECASE)
Found = Iterator[tuple[int, str]]
"""Lines, and what is there with the field's word for it."""


def in_name(name: str, line: int) -> Found:
    """Of a name."""
    parts = [part.lower() for part in PART.findall(name)]
    for allowed in ALLOWED:
        for at in range(len(parts) - len(allowed), -1, -1):
            if parts[at : at + len(allowed)] == allowed:
                del parts[at : at + len(allowed)]
    for part in (*parts, *map("_".join, itertools.pairwise(parts))):
        if part in FIELD:
            yield line, f"{name} -> {part}: {FIELD[part]}"


def in_text(text: str, line: int) -> Found:
    """Of a text; names in code are left out."""
    for found in SENTENCE.finditer(NO_SENTENCE.sub(lambda code: " " * len(code[0]), text)):
        around = text[max(0, found.start() - 30) : found.end() + 30].replace("\n", " ")
        yield line + text.count("\n", 0, found.start()), f"... {around} ... -> {found[0]}: {FIELD[found[0].lower()]}"


def in_module(source: str) -> Found:
    """Of a module's names where they are defined or assigned, its texts of two words and more, and its comments."""
    for node in ast.walk(ast.parse(source)):
        if type(node) in NAMED and not isinstance(getattr(node, "ctx", None), ast.Load | ast.Del):
            yield from in_name(getattr(node, NAMED[type(node)]), node.lineno)  # type: ignore[attr-defined]
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and " " in node.value.strip():
            yield from in_text(node.value, node.lineno)
    for line, text in enumerate(source.splitlines(), 1):
        yield from in_text(text.partition("# ")[2] if '"' not in text else "", line)


def main() -> int:
    """Print the places; the exit code."""
    places = []
    for path in (ROOT / name for name in sys.argv[1:] or LOOKED_AT):
        for file in [path] if path.is_file() else sorted(path.rglob("*.[pm][yd]")):
            source = file.read_text(encoding="utf-8")
            if file.suffix == ".py":
                found = [*in_name(file.stem, 0), *in_module(source)]
            else:
                found = list(in_text(CODE_BLOCK.sub(lambda block: "\n" * block[0].count("\n"), source), 1))
            places += [f"{file.relative_to(ROOT)}:{line}: {text}" for line, text in found if "_build" not in file.parts]
    print("\n".join([*places, f"{len(places)} places"]))
    return 1 if places else 0


if __name__ == "__main__":
    sys.exit(main())

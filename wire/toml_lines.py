"""On which line of a TOML file a key stands, which tomllib does not say."""

import re
import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from wire.small_files import read_text

_PART = r"(?:[A-Za-z0-9_-]+|\"[^\"]*\"|'[^']*')"
_KEY = rf"{_PART}(?:\s*\.\s*{_PART})*"
_LINE = re.compile(rf"\s*(?:(\[\[?)\s*({_KEY})\s*\]|({_KEY})\s*=(.*))", re.DOTALL)
_TEXT = re.compile(r"\"{3}.*?(?:\"{3}|$)|'{3}.*?(?:'{3}|$)|\"(?:[^\"\\\n]|\\.)*\"|'[^'\n]*'|#[^\n]*", re.DOTALL)


@dataclass(frozen=True, slots=True)
class Lines:
    """Of a file, its lines by key as messages have it, `followers[0].offset_m`, and the followers' names by theirs."""

    source: str
    lines: Mapping[str, int]
    bodies: Mapping[str, str]

    def of(self, key: str) -> str:
        """How a message begins: `lab.toml:14 followers[1].offset_m (left)`."""
        line, above = 0, key
        while above and not line:
            line = self.lines.get(above) or self.lines.get(f"{above}[0]", 0)
            above = above[: max(above.rfind("."), above.rfind("["), 0)]
        body = next((name for owner, name in self.bodies.items() if key.startswith(owner)), "")
        return f"{self.source}:{line or ''} {key}{f' ({body})' if body else ''}".rstrip()


def lines_of(path: Path) -> Lines:
    """Those of the file; none where it cannot be read any more."""
    try:
        text = read_text(path)
        values = tomllib.loads(text)
    except (OSError, ValueError):
        return Lines(str(path), {}, {})
    lines: dict[str, int] = {}
    for key, line in _keys(text):
        lines.setdefault(key, line)
    followers = values.get("followers")
    named = enumerate(followers if isinstance(followers, list) else ())
    bodies = {f"followers[{i}]": str(each["body"]) for i, each in named if isinstance(each, dict) and "body" in each}
    return Lines(str(path), lines, bodies)


def _keys(text: str) -> Iterator[tuple[str, int]]:
    """Each table and key of the text with its line, counted from 1; what is inside a list is at the list's."""
    table, counts, rest = "", dict[str, int](), ""
    for number, line in enumerate(text.splitlines(), 1):
        rest = f"{rest}\n{line}" if rest else line
        bare = _TEXT.sub("", rest)
        is_open = bare.count("[") + bare.count("{") > bare.count("]") + bare.count("}")
        if is_open or any(rest.count(mark) % 2 for mark in ('"""', "'''")):
            continue
        found, first, rest = _LINE.match(rest), number - rest.count("\n"), ""
        if found is None:
            continue
        if found[1] is None:
            yield f"{table}.{_plain(found[3])}".lstrip("."), first
            continue
        parts = _plain(found[2]).split(".")
        for k in range(len(parts) - (found[1] == "[[")):  # tables of the newest of a list
            inner = ".".join(parts[: k + 1])
            if inner in counts:
                parts = [f"{inner}[{counts[inner]}]", *parts[k + 1 :]]
                break
        table = ".".join(parts)
        if found[1] == "[[":
            counts[table] = counts.get(table, -1) + 1
            table = f"{table}[{counts[table]}]"
        yield table, first


def _plain(key: str) -> str:
    return re.sub(r"\s*\.\s*", ".", key).replace('"', "").replace("'", "")

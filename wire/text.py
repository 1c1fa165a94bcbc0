"""Texts from outside made harmless: words to print, JSON bounded before anything reads it; Markdown tables as data."""

import json
import math
import re
from typing import Any, NoReturn

_CONTROLS = {c: " " if chr(c).isspace() else None for c in range(0xA0) if not chr(c).isprintable()}


def plain(text: str, longest: int) -> str:
    """`text` without what a terminal or a page would act on, at most `longest` characters; white space reads as blanks.

    Only what Unicode calls printable is left: that ends ESC and C1 sequences, bidirectional overrides and zero widths.
    """
    text = text[: 4 * longest]
    if not text.isprintable():
        text = text.translate(_CONTROLS)
        if not text.isprintable():
            text = "".join(c if c.isprintable() else " " if c.isspace() else "" for c in text)
    return text if len(text) <= longest else text[: longest - 1] + "…"


MOST_CHARACTERS = 1 << 20
DEEPEST = 32
MOST_DIGITS = 19
"""Digits of a whole number: those of 64 bits."""

_DIGITS = bytes.maketrans(b"123456789E", b"000000000e")
_TEXTS = re.compile(r'"(?:[^"\\]|\\.)*"', re.DOTALL)
_BRACKETS = re.compile(r"[\[\]{}]")


class JsonError(ValueError):
    """The text is no JSON, or larger, deeper or with other numbers than any of ours."""


def parse_json(text: str | bytes) -> Any:
    """The value that the text stands for; JsonError for all else: NaN, infinities and numbers past 64 bits, too."""
    if len(text) > MOST_CHARACTERS:
        raise JsonError(f"more than {MOST_CHARACTERS} characters of JSON")
    try:
        if isinstance(text, bytes):
            text = text.decode()
        if text.count("[") + text.count("{") > DEEPEST and _depth(text) > DEEPEST:
            raise JsonError(f"JSON nested deeper than {DEEPEST} levels")
        if not _may_hold_large_numbers(text):  # nearly always; a call for every number takes ten times as long
            return json.loads(text, parse_constant=_no_constant)
        return json.loads(text, parse_int=_whole, parse_float=_real, parse_constant=_no_constant)
    except JsonError:
        raise
    except ValueError as error:  # bytes that are no text, too
        raise JsonError(f"no JSON: {error}") from error


def parse_object(text: str | bytes) -> dict[str, Any]:
    """The JSON object that the text stands for; JsonError for all else."""
    value = parse_json(text)
    if not isinstance(value, dict):
        raise JsonError("no JSON object")
    return value


def _may_hold_large_numbers(text: str) -> bool:
    """False where no number has so many digits, or so long an exponent, that `_whole` or `_real` could refuse it."""
    folded = text.encode(errors="replace").translate(_DIGITS, b"+")
    return b"0" * (MOST_DIGITS + 1) in folded or b"e000" in folded


def _depth(text: str) -> int:
    """How deep brackets are nested, those in texts left out."""
    depth = deepest = 0
    for bracket in _BRACKETS.findall(_TEXTS.sub("", text)):
        depth += 1 if bracket in "[{" else -1
        deepest = max(deepest, depth)
    return deepest


def _whole(digits: str) -> int:
    if len(digits.lstrip("-")) > MOST_DIGITS:
        raise JsonError(f"a whole number of more than {MOST_DIGITS} digits")
    return int(digits)


def _real(digits: str) -> float:
    value = float(digits)
    if not math.isfinite(value):
        raise JsonError("a number too large")
    return value


def _no_constant(word: str) -> NoReturn:
    raise JsonError(f"{word} is no number of JSON")


def number_text(value: float | None, times: float, digits: int, unknown: str = "-") -> str:
    """The value in another unit, `times` as large, with so many digits; None is unknown."""
    return unknown if value is None else f"{value * times:.{digits}f}"


def rows(table: str) -> list[dict[str, str]]:
    """Each row of the table by the names of its columns, code marks left out."""
    lines = [[cell.strip().replace("`", "") for cell in line.strip()[1:-1].split("|")] for line in table.splitlines()]
    names, _, *cells = lines
    return [dict(zip(names, row, strict=True)) for row in cells]
